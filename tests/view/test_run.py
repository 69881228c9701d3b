"""Simulated runs: what is drawn of them, when it is seen, and what is refused."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import k1607_pin as k1607
from k1607_pin import view
from k1607_pin.simulation.simulate import SimulationError
from k1607_pin.view.motion import FRAMES_PER_SECOND
from k1607_pin.view.offline import Recorder
from k1607_pin.view.run import Run, payload_keys, read_run
from k1607_pin.view.scene import Scene
from k1607_pin.view.traces import DENSITY
from k1607_pin.view.tubes import INDICES, dashed, far_apart, tubes

BENT = np.radians([20, -30, 10, 80, 0, 60, 0])
OFF = np.array([0.0, 0.05, 0.02])  # m, from the actual to the wanted place
MASS = 4.5  # kg


def a_run(arm, rest=BENT, rate=100.0, start=0.0):
    """4 s: swings out and back in 3 s and then rests, a payload in hand from 1 s to 2.5 s."""
    k = np.arange(round(4 * rate) + 1)
    t = k / rate
    swing = np.sin(np.pi * np.clip(t / 3, 0, 1)) ** 2
    Q = rest[: arm.n] + np.outer(swing, np.resize([0.1, -0.5, 0.2], arm.n))
    tool = arm.forward_kinematics(Q)[:, :3, 3]
    carried = (k >= round(rate)) & (k < round(2.5 * rate))
    return xr.Dataset(
        {
            "q": (("time", "joint"), Q),
            "tool_position": (("time", "axis"), tool),
            "wanted_position": (("time", "axis"), tool + OFF),
            "payload": ("time", MASS * carried),
        },
        coords={"time": start + t, "joint": list(arm.joint_names), "axis": ["x", "y", "z"]},
    )


def held(times, values, t):
    """The value that the viewer holds at t, of a track in steps."""
    return values[np.searchsorted(times, t, side="right") - 1]


@pytest.fixture(scope="module")
def drawn(reference, draw):
    return draw(reference, a_run(reference, start=7.0))


# When the payload is seen


def test_the_payload_is_seen_from_the_very_sample_on_that_has_it_to_the_one_that_has_not(drawn):
    times, visible = drawn.track("payload/<object>", ".visible")
    assert visible.dtype == bool
    t = np.array([0.0, 0.999, 1.001, 2.499, 2.501, 4.0])
    assert held(times, visible, t).tolist() == [False, False, True, True, False, False]


def test_the_ball_has_the_payloads_mass_at_one_density(drawn):
    times, scale = drawn.track("payload/<object>", ".scale")
    radii = held(times, scale.reshape(-1, 3), np.array([1.5]))
    np.testing.assert_allclose(DENSITY * 4 / 3 * np.pi * radii**3, MASS, rtol=1e-5)  # float32


@given(
    masses=st.lists(st.sampled_from([0.0, 1.0, 2.5]), min_size=2, max_size=300),
    rate=st.sampled_from([3.0, 30.0, 100.0, 1000.0]),
    start=st.sampled_from([0.0, -3.0, 12.5]),
)
def test_keys_of_any_payload(masses, rate, start):
    masses = np.array(masses)
    seconds = np.arange(len(masses)) / rate
    times, carried = payload_keys(
        Run(start + seconds, np.zeros((len(masses), 7)), None, masses, np.zeros((len(masses), 3)), None)
    )
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(seconds[-1])
    assert (np.diff(times) > 0).all()
    k = np.rint(times * rate).astype(int)
    assert (carried == masses[k]).all()  # never what the hand did not carry at that time
    frames = np.unique(np.floor(times * FRAMES_PER_SECOND + 1e-6))
    assert len(times) <= 2 * len(frames) + 2
    # What is seen at the end of a frame is what is carried there.
    now = np.searchsorted(times, seconds + 1e-9, side="right") - 1
    ends = np.flatnonzero(np.diff(np.floor(seconds * FRAMES_PER_SECOND)) > 0)
    late = masses[ends] != carried[now[ends]]
    assert not late[np.abs(seconds[ends] * FRAMES_PER_SECOND % 1 - 0.5) < 0.49].any()  # on the edge it may be the next
    if rate <= FRAMES_PER_SECOND:
        assert (masses == carried[now]).all()  # sparse ones are kept whole


def test_a_ramp_grows_the_ball_by_frames_and_not_by_samples(reference, draw):
    run = a_run(reference, rate=1000.0)
    run["payload"] = ("time", np.clip(run.time.values - 1, 0, 2))  # kg
    times, scale = draw(reference, run).track("payload/<object>", ".scale")
    radii = scale.reshape(-1, 3)[:, 0]
    assert 100 < len(times) < 130
    growing = (times > 1.1) & (times < 3)
    mass = DENSITY * 4 / 3 * np.pi * radii**3
    np.testing.assert_allclose(mass[growing], times[growing] - 1, rtol=1e-4)
    assert (np.diff(radii[1:]) >= 0).all()


# Where things are


def test_the_points_follow_the_tool_and_the_wanted_place(reference, drawn):
    run = a_run(reference)
    for node, places in (
        ("actual now", run.tool_position),
        ("wanted now", run.wanted_position),
        ("payload", run.tool_position),
    ):
        times, positions = drawn.track(node, ".position")
        expected = np.stack([np.interp(times, run.time, x) for x in places.values.T], axis=1)
        np.testing.assert_allclose(positions.reshape(-1, 3), expected, atol=2e-5)  # arcs between samples of 10 ms


def test_the_actual_path_reaches_to_the_tool_and_no_farther(reference, drawn):
    times, counts = drawn.track("actual/<object>", ".geometry[drawRange].count")
    middles = drawn.vertices("actual").reshape(-1, 2, INDICES // 6, 3).mean(axis=2)  # start and end of each piece
    assert counts[0] == 0
    assert counts[-1] == INDICES * len(middles)
    tool_times, tool = drawn.track("actual now", ".position")
    for t in (0.3, 1.0, 1.5, 2.2, 2.9, 4.0):
        pieces = int(held(times, counts, t)) // INDICES
        now = np.array([np.interp(t, tool_times, x) for x in tool.reshape(-1, 3).T])
        assert np.linalg.norm(middles[pieces - 1, 1] - now) < 0.03  # a frame's way, at 0.6 m/s
    np.testing.assert_allclose(middles[1:, 0], middles[:-1, 1], atol=1e-6)  # no gaps


def test_every_track_is_as_long_as_the_run(reference, drawn, draw):
    """The viewer repeats each thing after its own last key: a shorter one would fall out of step."""
    stops_dead = a_run(reference)
    stops_dead["q"][100:] = stops_dead.q[100].values
    for shown in (drawn, draw(reference, stops_dead.drop_vars("tool_position"))):
        assert {float(times[0]) for clip in shown.clips.values() for times, _ in clip.values()} == {0.0}
        assert {float(times[-1]) for clip in shown.clips.values() for times, _ in clip.values()} == {4.0}


@given(
    points=st.lists(st.tuples(*[st.floats(-2, 2)] * 3), min_size=2, max_size=30),
    dash=st.floats(0.01, 1.0),
    gap=st.floats(0.01, 1.0),
)
def test_dashes_lie_on_the_path_in_their_share(points, dash, gap):
    points = np.array(points)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    points = points[np.concatenate([[True], steps > 1e-3])]
    if len(points) < 2 or (length := np.linalg.norm(np.diff(points, axis=0), axis=1).sum()) < 1e-3:
        return
    starts, ends = dashed(points, dash, gap)
    np.testing.assert_allclose(starts[0], points[0])
    drawn = np.linalg.norm(ends - starts, axis=1)
    assert (drawn > 0).all()
    whole, rest = divmod(length, dash + gap)
    assert drawn.sum() == pytest.approx(whole * dash + min(rest, dash), abs=1e-6)
    a, b = points[:-1], np.diff(points, axis=0)
    for x in np.vstack([starts, ends]):
        share = np.clip(((x - a) * b).sum(axis=1) / (b**2).sum(axis=1), 0, 1)
        assert np.linalg.norm(a + share[:, None] * b - x, axis=1).min() < 1e-9


@given(points=st.lists(st.tuples(*[st.floats(-2, 2)] * 3), min_size=1, max_size=40), step=st.floats(0.01, 1.0))
def test_chosen_points_are_apart_and_bring_every_point_near(points, step):
    points = np.array(points)
    chosen = far_apart(points, step)
    assert chosen[0] == 0
    assert (points[chosen[-1]] == points[-1]).all()
    apart = np.linalg.norm(np.diff(points[chosen], axis=0), axis=1)
    assert (apart[:-1] >= step).all()
    assert (apart > 0).all()
    last = points[chosen[np.searchsorted(chosen, np.arange(len(points)), side="right") - 1]]
    assert (np.linalg.norm(points - last, axis=1) < step).all()


@pytest.mark.parametrize("along", [[1, 0, 0], [0, -1, 0], [0, 0, 1], [1, 2, -3], [1, 1, 1]])
def test_a_tube_has_its_radius_all_along(along):
    along = np.array(along, dtype=float)
    start = np.array([0.3, -0.2, 0.9])
    tube = tubes(start[None], (start + along)[None], 0.05)
    axis = along / np.linalg.norm(along)
    offset = tube.vertices - start
    far = offset @ axis
    np.testing.assert_allclose(np.linalg.norm(offset - far[:, None] * axis, axis=1), 0.05, atol=1e-6)
    np.testing.assert_allclose(np.unique(far.round(5)), [0, np.linalg.norm(along).round(5)], atol=1e-5)
    assert tube.faces.size == INDICES
    assert len(np.unique(tube.faces)) == len(tube.vertices)


# What is drawn of which run


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_any_arm(name, draw):
    arm = k1607.load_example(name)
    rest = np.array([0.0, -0.4, 0.2, -2.0, 0.1, 1.7, 0.8])
    assert "/meshcat/run/payload" in draw(arm, a_run(arm, rest)).objects


def test_the_legend_names_what_is_there(reference, drawn, draw):
    for text in ("actual path", "desired path", "payload, 4.5 kg"):
        assert f">{text}</text>" in drawn.legend
    run = a_run(reference)
    run["payload"] = run.payload * np.linspace(0.5, 1, len(run.time))
    assert "payload, up to 3.65 kg" in draw(reference, run).legend


def test_a_run_of_angles_alone_shows_the_actual_path_alone(reference, draw):
    drawn = draw(reference, a_run(reference)[["q"]])
    assert {path.split("/")[-1] for path in drawn.objects if "/run/" in path} == {"actual", "actual now"}
    assert ">actual path<" in drawn.legend
    assert "desired" not in drawn.legend
    assert "payload" not in drawn.legend


def test_an_arm_that_stays_where_it_is_has_a_point_and_no_path(reference, draw):
    run = a_run(reference).isel(time=slice(310, None))
    drawn = draw(reference, run)
    assert {path.split("/")[-1] for path in drawn.objects if "/run/" in path} == {"actual now", "wanted now"}


def test_dimensions_in_another_order_are_the_same_run(reference):
    run = a_run(reference)
    assert view.html(reference, run.transpose("joint", "axis", "time")) == view.html(reference, run)


def test_what_is_shown_next_takes_the_run_away(reference):
    window = Recorder()
    scene = Scene(reference, window)
    for show in (lambda: scene.display(BENT), lambda: scene.play([0.0, 1.0], np.stack([BENT, 0 * BENT]))):
        scene.play(a_run(reference))
        assert [path for _, path, _ in window._commands if "/run/" in path or "legend" in path]
        show()
        assert not [path for _, path, _ in window._commands if "/run/" in path or "legend" in path]


def test_ten_thousand_samples_make_a_small_page(reference):
    run = a_run(reference, rate=2500.0)
    assert run.sizes["time"] == 10_001
    still = len(view.html(reference, Q=BENT, frames=False))
    page = view.html(reference, run)
    assert len(page) < still + 250_000
    assert page == view.html(reference, run)


def test_a_simulation_that_failed_is_drawn_as_far_as_it_came(reference, draw):
    class Runaway:
        def start(self, q, v, duration=None):
            return None

        def update(self, t, q, v, state):
            return (np.full(7, np.nan) if t > 0.2 else 1e3 * v + 1.0), None, {"wanted_position": np.ones(3)}

    with pytest.raises(SimulationError) as failed:
        k1607.simulate(reference, Runaway(), BENT, 2.0)
    log = failed.value.log
    assert 2 <= log.sizes["time"] < 100
    draw(reference, log)


def test_a_run_of_one_sample_is_a_picture(reference, draw):
    run = a_run(reference).isel(time=slice(150, 151))
    drawn = draw(reference, run)
    times, positions = drawn.track("actual now", ".position")
    assert times[-1] == pytest.approx(1 / FRAMES_PER_SECOND)
    np.testing.assert_allclose(positions.reshape(-1, 3), np.repeat(run.tool_position.values, len(times), 0), atol=1e-6)
    assert drawn.track("payload/<object>", ".visible")[1].all()


# What is refused


def with_nan(run, name):
    values = run[name].values.copy()
    values[7:] = np.nan
    return run.assign({name: (run[name].dims, values)})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda run: run.drop_vars("q"), r"run: expected q \(time, 7\) in rad, got a dataset of tool_position, "),
        (lambda run: run.drop_vars("time"), r"run: expected time \(time\) in s, got a dataset of q, "),
        (lambda run: xr.Dataset(), r"run: expected time \(time\) in s, got a dataset of nothing"),
        (lambda run: run.isel(joint=slice(6)), r"run: expected q \(time, 7\) in rad, got shape \(401, 6\)"),
        (lambda run: run.isel(joint=0), r"run: expected q \(time, 7\) in rad, got dimensions \('time',\)"),
        (lambda run: run.isel(time=slice(0)), r"run: expected time \(time\) in s, got shape \(0,\)"),
        (lambda run: run.isel(time=3), r"run: expected time \(time\) in s, got dimensions \(\)"),
        (
            lambda run: run[["q"]].expand_dims(case=2),
            r"got dimensions \('case', 'time', 'joint'\); choose one .* \.isel",
        ),
        (lambda run: run.isel(axis=slice(2)), r"run: expected wanted_position \(time, 3\) in m, got shape \(401, 2\)"),
        (
            lambda run: with_nan(run, "q"),
            r"run: expected q .* finite, got 394 samples that are not, the first at sample 7",
        ),
        (lambda run: with_nan(run, "wanted_position"), r"run: expected wanted_position \(time, 3\) in m, all finite"),
        (lambda run: with_nan(run, "payload"), r"run: expected payload \(time\) in kg, all finite"),
        (lambda run: run.assign(payload=-run.payload), r"run: expected payload >= 0 kg, got -4.5 kg at 1 s"),
        (
            lambda run: run.isel(time=slice(None, None, -1)),
            "times: expected increasing numbers in s, got 4.0 s and then",
        ),
        (
            lambda run: run.assign_coords(time=(1e9 * run.time).astype("timedelta64[ns]")),
            r"run: expected time \(time\) in s, got numbers of type timedelta64",
        ),
        (
            lambda run: run.assign(tool_position=run.tool_position + 0.1),
            r"run: expected the tool where 'k1607' has its frame 'tool', got a tool_position 0.173 m from there at 0 s",
        ),
    ],
)
def test_a_bad_run_says_what_was_expected(reference, tmp_path, change, message):
    with pytest.raises(ValueError, match=message):
        view.save_html(reference, tmp_path / "run.html", change(a_run(reference)))
    assert list(tmp_path.iterdir()) == []


def test_the_run_of_another_arm_is_refused(reference):
    panda = k1607.load_example("panda")
    with pytest.raises(ValueError, match="is it the run of another arm, or of another tool frame"):
        read_run(reference, a_run(panda, np.array([0.0, -0.4, 0.2, -2.0, 0.1, 1.7, 0.8])))


def test_angles_beside_a_run_are_refused(reference):
    with pytest.raises(ValueError, match="Q: expected nothing beside a run"):
        view.html(reference, a_run(reference), BENT)


# What a person sees


PURPLE, ORANGE, DARK = ((0.74, 0.88), 0.2), ((0.04, 0.12), 0.7), ((0.55, 0.68), 0.6)  # hues, least saturation


@pytest.mark.parametrize("name", ["k1607", "panda"])
def test_the_payload_is_in_the_picture_while_it_is_carried(name, page, picture, pixels_of, tmp_path, scrub, count):
    arm = k1607.load_k1607() if name == "k1607" else k1607.load_example(name)
    rest = BENT if name == "k1607" else np.array([0.0, -0.4, 0.2, -2.0, 0.1, 1.7, 0.8])
    path = view.save_html(arm, tmp_path / "run.html", a_run(arm, rest))
    page.context.set_offline(True)
    page.goto(path.as_uri())
    page.evaluate("drawn")
    assert not page.evaluate("viewer.scene_tree.find(['meshcat', 'frames']).object.visible")
    for seconds, seen in ((0.9, False), (1.1, True), (2.6, False)):
        scrub(seconds)
        mask = pixels_of("meshcat/run/payload")
        assert mask.any() == seen
        if seen:
            assert mask.sum() > 200
            assert count(picture()[mask], PURPLE) > 0.5 * mask.sum()
    assert page.errors == []


def test_the_actual_path_grows_beside_the_wanted_one_and_both_are_told_apart(
    page, picture, pixels_of, tmp_path, scrub, count
):
    arm = k1607.load_k1607()
    page.goto(view.save_html(arm, tmp_path / "run.html", a_run(arm)).as_uri())
    page.evaluate("drawn")
    lengths = []
    for seconds in (0.0, 0.8, 1.5):
        scrub(seconds)
        lengths.append(pixels_of("meshcat/run/actual").sum())
        wanted = pixels_of("meshcat/run/wanted")
        assert wanted.sum() > 300
        assert count(picture()[wanted], ORANGE) > 0.6 * wanted.sum()
    assert lengths[0] == 0
    assert 100 < lengths[1] < lengths[2]
    actual = pixels_of("meshcat/run/actual")
    assert count(picture()[actual], DARK) > 0.4 * actual.sum()
    for node in ("actual now", "wanted now"):
        assert pixels_of(f"meshcat/run/{node}").sum() > 20
    text = pixels_of("Cameras/default/rotated/<object>/legend")
    assert np.nonzero(text)[0].min() > 0.9 * text.shape[0]


@pytest.mark.parametrize(("width", "height"), [(800, 480), (600, 700)])
def test_the_controls_are_seen_and_do_not_cover_the_run(width, height, page, browser, tmp_path, reference, scrub):
    page.set_viewport_size({"width": width, "height": height})
    page.goto(view.save_html(reference, tmp_path / "run.html", a_run(reference)).as_uri())
    page.evaluate("drawn")
    for name in ("play", "pause", "reset", "time"):
        assert page.get_by_text(name, exact=True).first.is_visible()
    for seconds in (0.0, 1.5):
        scrub(seconds)
        page.evaluate("viewer.render()")
        corners = page.evaluate(
            """() => {
                const tree = viewer.scene_tree, run = tree.find(["meshcat", "run"]).children;
                viewer.scene.updateMatrixWorld(true);
                return Object.values(run).flatMap((node) => {
                    const at = node.object.getWorldPosition(node.object.position.clone());
                    const box = new MeshCat.THREE.Box3().setFromObject(node.object);
                    return [box.min, box.max, at].map((x) => x.project(viewer.camera).toArray());
                });
            }"""
        )
        x = (np.array(corners)[:, 0] + 1) / 2 * width
        left = page.evaluate("viewer.gui.domElement.getBoundingClientRect().left")
        assert 0 < x.min()
        assert x.max() < left


def test_a_run_plays_live_also_for_who_comes_later(page, reference, scrub):
    run = a_run(reference)
    run["payload"] = run.payload.where(run.time < 2, 2 * run.payload)
    with view.show(reference, run) as live:
        page.goto(live.url)
        page.wait_for_function("viewer.animator.duration > 3.9 && viewer.camera.fov < 40")
        assert page.get_by_text("pause", exact=True).first.is_visible()
        for seconds, seen in ((0.5, False), (1.5, True), (3.0, False)):
            scrub(seconds)
            path = ["meshcat", "run", "payload", "<object>"]
            assert page.evaluate("(path) => viewer.scene_tree.find(path).object.visible", path) == seen
            path = ["meshcat", "run", "actual", "<object>"]
            drawn = page.evaluate("(path) => viewer.scene_tree.find(path).object.geometry.drawRange.count", path)
            assert 0 < drawn < np.inf
            assert drawn % INDICES == 0
        scrub(1.9)  # between two keys
        radius = page.evaluate("viewer.scene_tree.find(['meshcat', 'run', 'payload', '<object>']).object.scale.x")
        assert DENSITY * 4 / 3 * np.pi * radius**3 == pytest.approx(MASS, rel=1e-5)
        live.display(BENT)
        page.wait_for_function(
            "viewer.animator.actions.length == 0 && !viewer.scene_tree.find(['meshcat']).children.run"
        )
    assert page.errors == []
