"""Walls and contact forces: where the patch is, what the arrow says and when, and what is refused."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import k1607_pin as k1607
from k1607_pin import view
from k1607_pin.simulation.wall import Wall
from k1607_pin.view.contact import LONGEST, OPACITY, PEAK, WALL, full_scale, patch
from k1607_pin.view.motion import FRAMES_PER_SECOND
from k1607_pin.view.run import Run, contact_keys

BENT = np.radians([-20, 30, 20, 100, -30, 60, 10])
SLANTED = np.array([-0.6, 0.2, 0.3])
NUMBER = st.floats(-1, 1)
VECTOR = st.tuples(NUMBER, NUMBER, NUMBER).map(np.array)


def a_contact(arm, force, seconds=2.0, rate=100.0):
    """A wipe of ``seconds`` in which ``force`` of (N,) s gives the (N, 3) N on the tool."""
    t = np.arange(round(seconds * rate) + 1) / rate
    Q = BENT[: arm.n] + np.outer(np.sin(t), np.resize([0.1, -0.05, 0.1], arm.n))
    variables = {"q": (("time", "joint"), Q), "contact_force": (("time", "axis"), force(t))}
    return xr.Dataset(variables, coords={"time": t})


def steady(t):
    """20 N from 0.5 s to 1.5 s, a little less at the edges."""
    return np.outer(np.where((t >= 0.5) & (t < 1.5), 20 - 5 * np.abs(t - 1), 0), SLANTED / np.linalg.norm(SLANTED))


def wall_at_the_tool(arm):
    return Wall(arm.forward_kinematics(BENT[: arm.n]).translation, SLANTED, 1e4)


class Arrow:
    """What the tracks make of the arrow at its keys: tail and tip (K, 3) m from the tool, and whether it is seen (K,)."""

    def __init__(self, drawn):
        self.times, quaternions = drawn.track("contact", ".quaternion")
        turned = Rotation.from_quat(quaternions.reshape(-1, 4))
        ends = {}
        for part in ("head", "shaft"):
            node = f"contact/{part}/<object>"
            times, middle = drawn.track(node, ".position")
            assert np.array_equal(times, self.times)
            (cylinder,) = drawn.objects[f"/meshcat/run/contact/{part}"]["geometries"]
            half = cylinder["height"] * drawn.track(node, ".scale")[1].reshape(-1, 3)[:, 1] / 2
            y = middle.reshape(-1, 3)[:, 1]
            ends[part] = y - half, y + half
            self.seen = drawn.track(node, ".visible")[1]
        np.testing.assert_allclose(ends["shaft"][1], ends["head"][0], atol=1e-6)  # in one piece
        self.tail, self.tip = (turned.apply(np.outer(y, [0, 1, 0])) for y in (ends["shaft"][0], ends["head"][1]))


@pytest.fixture(scope="module")
def size(reference, draw):
    return draw(reference, a_contact(reference, steady)).scene._size


# The arrow


@given(
    strengths=st.lists(st.sampled_from([0.0, 0.0, 5.0, 20.0, 500.0]), min_size=2, max_size=300),
    rate=st.sampled_from([3.0, 30.0, 100.0, 1000.0]),
    start=st.sampled_from([0.0, -3.0, 12.5]),
)
def test_keys_are_samples_and_no_frame_loses_its_largest(strengths, rate, start):
    force = np.outer(strengths, [0.0, 0.6, -0.8])
    seconds = np.arange(len(force)) / rate
    none = np.zeros(len(force))
    times, kept = contact_keys(Run(start + seconds, np.zeros((len(force), 7)), None, none, force, None))
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(seconds[-1])
    assert (np.diff(times) > 0).all()
    assert np.array_equal(kept, force[np.rint(times * rate).astype(int)])
    # A window of a frame and a bit more holds a key, and no force in it goes beyond the keys around.
    near = np.abs(times - seconds[:, None]) <= 1 / FRAMES_PER_SECOND + 1e-9
    around = np.where(near, np.linalg.norm(kept, axis=1), -1).max(axis=1)
    assert (around >= np.linalg.norm(force, axis=1) - 1e-9).all()
    assert len(times) <= np.ceil(seconds[-1] * FRAMES_PER_SECOND) + 3


def test_the_arrow_ends_at_the_tool_and_is_the_force_to_scale(reference, draw, size):
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(61, 3))
    directions[10] = -directions[9]  # turns right round
    directions[20] = directions[19]
    directions[30] = [0.0, -1.0, 0.0]
    forces = directions / np.linalg.norm(directions, axis=1, keepdims=True) * rng.uniform(5, 9, (61, 1))
    forces[40:45] = 0.0
    forces[0] = [0.0, -1e-3, 0.0]  # hardly any, and opposite to the arrow as it is made
    run = a_contact(reference, lambda t: forces, rate=30.0)
    drawn = draw(reference, run)
    arrow = Arrow(drawn)
    np.testing.assert_allclose(arrow.tip, 0, atol=1e-6)
    keys = np.searchsorted(run.time.values, arrow.times - 1e-3)
    largest = np.linalg.norm(forces, axis=1).max()
    np.testing.assert_allclose(-arrow.tail, forces[keys] / largest * LONGEST * size, atol=2e-6)
    assert np.array_equal(arrow.seen, forces[keys].any(axis=1))
    _, at = drawn.track("contact", ".position")
    np.testing.assert_array_equal(at, drawn.track("actual now", ".position")[1])


def test_between_keys_the_arrow_turns_the_short_way(reference, draw):
    """Half way in a rotation from one key to the next it points half way between the two forces."""
    directions = np.random.default_rng(3).normal(size=(61, 3))
    drawn = draw(reference, a_contact(reference, lambda t: directions, rate=30.0))
    turned = Rotation.from_quat(drawn.track("contact", ".quaternion")[1].reshape(-1, 4))
    change = turned[1:] * turned[:-1].inv()
    half = Rotation.from_rotvec(change.as_rotvec() / 2) * turned[:-1]
    tips = turned.apply([0, 1, 0])
    middle = tips[:-1] + tips[1:]
    np.testing.assert_allclose(half.apply([0, 1, 0]), middle / np.linalg.norm(middle, axis=1, keepdims=True), atol=1e-4)


@pytest.mark.parametrize("rate", [100.0, 1000.0])
def test_the_arrow_is_seen_while_there_is_a_force(reference, draw, rate):
    arrow = Arrow(draw(reference, a_contact(reference, steady, rate=rate)))
    shown = arrow.seen[np.searchsorted(arrow.times, np.arange(0, 2, 0.01) + 1e-6, side="right") - 1]
    on, off = np.flatnonzero(np.diff(shown.astype(int))) / 100
    assert shown.sum() > 0
    assert on == pytest.approx(0.5, abs=1 / FRAMES_PER_SECOND + 0.01)
    assert off == pytest.approx(1.5, abs=1 / FRAMES_PER_SECOND + 0.01)


def test_an_impact_is_seen_and_does_not_make_the_rest_invisible(reference, draw, size):
    def with_impact(t):
        return steady(t) * np.where(np.abs(t - 0.71) < 2.5e-3, 50.0, 1.0)[:, None]

    run = a_contact(reference, with_impact, rate=1000.0)
    drawn = draw(reference, run)
    arrow = Arrow(drawn)
    length = np.linalg.norm(arrow.tail, axis=1) / (LONGEST * size)
    assert length.max() == pytest.approx(1.0, rel=1e-5)
    impact = np.argmax(length)
    assert arrow.times[impact] == pytest.approx(0.71, abs=2.6e-3)  # its very time, though it is shorter than a frame
    rest = arrow.seen & (np.arange(len(length)) != impact)
    assert length[rest].min() > 0.8 / PEAK
    assert length[rest].max() < 1.1 / PEAK
    full = full_scale(run.contact_force.values)
    assert f">contact force, up to 928 N (arrow up to {full:.3g} N)<" in drawn.legend


def test_without_a_peak_the_largest_force_is_the_longest_arrow(reference, draw, size):
    drawn = draw(reference, a_contact(reference, steady))
    assert np.linalg.norm(Arrow(drawn).tail, axis=1).max() == pytest.approx(LONGEST * size, rel=1e-5)
    assert ">contact force, up to 20 N<" in drawn.legend


# The wall


@given(point=VECTOR, normal=VECTOR.filter(lambda n: np.linalg.norm(n) > 1e-3), path=st.lists(VECTOR, min_size=1))
def test_the_patch_is_a_square_in_the_wall_around_the_tools_shadow_on_it(point, normal, path):
    wall, tool = Wall(point, normal, 1e4), np.array(path)
    corners = patch(wall, tool, 0.5)
    np.testing.assert_allclose((corners - wall.point) @ wall.normal, 0, atol=1e-9)
    sides = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(sides, axis=1)
    np.testing.assert_allclose(lengths, lengths[0])
    np.testing.assert_allclose((sides * np.roll(sides, 1, axis=0)).sum(axis=1), 0, atol=1e-9)
    inside = (tool - corners[0]) @ (sides[[0, 3]] * [[1], [-1]] / lengths[0]).T  # along two sides, from a corner
    assert (inside > 0.05).all()
    assert (inside < lengths[0] - 0.05).all()
    np.testing.assert_allclose(inside.min(axis=0) + inside.max(axis=0), lengths[0], atol=1e-9)  # centred
    if np.hypot(*normal[:2]) > 1e-2 * np.linalg.norm(normal):
        assert np.abs(sides[:, 2]).min() < 1e-9  # level


def run_nodes(drawn):
    return {path.split("/")[3] for path in drawn.objects if "/run/" in path}


def test_what_is_there_is_drawn_and_named(reference, draw):
    wall, run = wall_at_the_tool(reference), a_contact(reference, steady)
    both, arrow, face = draw(reference, run, wall), draw(reference, run), draw(reference, run[["q"]], wall)
    untouched = draw(reference, a_contact(reference, lambda t: np.zeros((len(t), 3))))
    for drawn, nodes in ((both, {"wall", "contact"}), (arrow, {"contact"}), (face, {"wall"}), (untouched, set())):
        assert run_nodes(drawn) - {"actual", "actual now"} == nodes
        assert (">wall<" in drawn.legend) == ("wall" in nodes)
        assert ("contact force" in drawn.legend) == ("contact" in nodes)
    for name in ("wall/patch", "contact/head"):
        (material,) = both.objects[f"/meshcat/run/{name}"]["materials"]
        assert material["transparent"]
    assert both.clips.keys() == arrow.clips.keys()
    for clip in both.clips.values():
        assert {(float(times[0]), float(times[-1])) for times, _ in clip.values()} == {(0.0, 2.0)}


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_any_arm(name, draw):
    arm = k1607.load_example(name)
    run = a_contact(arm, steady).isel(time=slice(100, 101))  # one sample: a simulation that failed at once
    drawn = draw(arm, run, wall_at_the_tool(arm))
    assert {"wall", "contact"} <= run_nodes(drawn)
    assert Arrow(drawn).seen.all()


def test_a_simulated_contact_is_drawn_as_it_was(reference, draw, size):
    """The tool falls on a floor: the arrow is what the wall says of the state."""

    class Limp:
        def start(self, q, v, duration):
            return None

        def update(self, t, q, v, state):
            return np.zeros(7), None, {}

    floor = Wall(reference.forward_kinematics(BENT).translation - [0, 0, 0.02], [0, 0, 1], 1e4, 100.0, 0.3)
    run = k1607.simulate(
        reference, Limp(), BENT, 0.3, control_period=0.002, physics_step=0.001, external=floor.external(reference)
    )
    arrow = Arrow(draw(reference, run, floor))
    keys = np.rint(arrow.times / 0.002).astype(int)
    force = np.array([floor.sensor(reference)(0.0, run.q.values[k], run.v.values[k])[:3] for k in keys])
    assert arrow.seen.any()
    assert not arrow.seen[0]
    full = full_scale(run.contact_force.values)
    strength = np.linalg.norm(force, axis=1, keepdims=True)
    expected = -force / np.maximum(strength, full) * LONGEST * size
    np.testing.assert_allclose(arrow.tail, expected, atol=1e-5)


# What is refused


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (lambda run, wall: {"times": run, "wall": (wall.point, wall.normal)}, "wall: expected a Wall.*got .array"),
        (lambda run, wall: {"times": run, "wall": "stone"}, "wall: expected a Wall.*got 'stone'"),
        (lambda run, wall: {"Q": BENT, "wall": wall}, "wall: expected it beside a run of simulate"),
        (lambda run, wall: {"times": [0.0, 1.0], "Q": [BENT, BENT], "wall": wall}, "wall: expected it beside a run"),
        (
            lambda run, wall: {"times": run.isel(axis=slice(2)), "wall": wall},
            r"run: expected contact_force \(time, 3\) in N, got shape \(201, 2\)",
        ),
        (
            lambda run, wall: {"times": run.assign(contact_force=run.contact_force.isel(axis=0)), "wall": wall},
            r"run: expected contact_force \(time, 3\) in N, got dimensions \('time',\)",
        ),
        (
            lambda run, wall: {"times": run.assign(contact_force=run.contact_force / 0.0), "wall": wall},
            r"run: expected contact_force \(time, 3\) in N, all finite",
        ),
    ],
)
def test_a_bad_wall_or_force_says_what_was_expected(reference, given, message):
    arguments = given(a_contact(reference, steady), wall_at_the_tool(reference))
    for function in (view.html, view.notebook, view.show):
        with pytest.raises(ValueError, match=message):
            function(reference, **arguments)
    with pytest.raises(ValueError, match=message):
        view.Scene(reference, view.offline.Recorder()).play(**{"times": None} | arguments)


# What a person sees

RED, TEAL = ((0.93, 1.0), 0.7), ((0.44, 0.52), 0.3)  # hues, least saturation


def test_wall_and_arrow_are_in_the_picture_and_the_wall_hides_nothing(
    page, picture, pixels_of, switch, scrub, count, tmp_path, reference
):
    """The arrow is seen while there is a force, on the side that the world pushes from."""
    run, wall = a_contact(reference, steady), wall_at_the_tool(reference)
    path = view.save_html(reference, tmp_path / "run.html", run, wall=wall)
    page.goto(path.as_uri())
    page.evaluate("drawn")
    for seconds, seen in ((0.3, False), (1.0, True), (1.7, False)):
        scrub(seconds)
        arrow = pixels_of("meshcat/run/contact")
        assert arrow.any() == seen
        if seen:
            assert arrow.sum() > 200
            assert count(picture()[arrow], RED) > 0.7 * arrow.sum()
            wanted_tail, wanted_tip = on_screen(page, reference, run.q.values[100], arrow.shape)
            rows, columns = np.nonzero(arrow)
            tail_to_tip = wanted_tip - wanted_tail
            along = (np.stack([columns, rows], axis=1) - wanted_tail) @ tail_to_tip / (tail_to_tip @ tail_to_tip)
            assert -0.05 < along.min() < 0.05
            assert 0.85 < along.max() < 1.05  # the point of the tool is drawn over its tip
            wide = [np.sum(np.abs(along - x) < 0.03) for x in (0.4, 0.84)]
            assert wide[1] > 1.5 * wide[0]  # the head is at the tool
    frame, face = pixels_of("meshcat/run/wall/frame"), pixels_of("meshcat/run/wall/patch")
    for mask in (frame, face):
        assert mask.sum() > 500
    assert count(picture()[frame], TEAL) > 0.7 * frame.sum()
    with_wall = picture()[face]
    switch("meshcat/run/wall/patch", False)
    behind = picture()[face]  # shines through
    expected = (1 - OPACITY) * behind + OPACITY * np.array(list(WALL.to_bytes(3, "big")))
    assert np.mean(np.abs(with_wall - expected).max(axis=1) < 2) > 0.97  # of 255; all but edges
    assert page.errors == []


def test_a_wall_far_from_the_arm_is_in_the_picture_too(page, pixels_of, scrub, tmp_path, reference):
    wall = Wall([4.0, 0.0, 0.0], [-1.0, 0.0, 0.0], 1e4)
    page.goto(view.save_html(reference, tmp_path / "run.html", a_contact(reference, steady), wall=wall).as_uri())
    page.evaluate("drawn")
    scrub(1.0)
    frame = pixels_of("meshcat/run/wall/frame")
    assert frame.sum() > 100
    assert not frame[[0, -1]].any()
    assert not frame[:, [0, -1]].any()


def on_screen(page, arm, q, shape):
    """Pixels (2,) of where the arrow should begin and end, by the viewer's own camera."""
    tool = arm.forward_kinematics(q).translation
    pushed_from = tool - SLANTED / np.linalg.norm(SLANTED) * LONGEST * view.Scene(arm, view.offline.Recorder())._size
    return [
        (np.array([1, -1]) * page.evaluate(
            """(x) => {
                const root = viewer.scene_tree.find(["meshcat"]).object;
                viewer.scene.updateMatrixWorld(true);
                const at = root.localToWorld(root.position.clone().fromArray(x)).project(viewer.camera);
                return [at.x, at.y];
            }""", point.tolist()) + 1) / 2 * shape[::-1]
        for point in (pushed_from, tool)
    ]  # fmt: skip


def test_a_contact_plays_live_with_its_wall(page, scrub, reference):
    run, wall = a_contact(reference, steady), wall_at_the_tool(reference)
    with view.show(reference, run, wall=wall) as live:
        page.goto(live.url)
        page.wait_for_function("viewer.animator.duration > 1.9 && viewer.camera.fov < 40")
        for seconds, seen in ((0.2, False), (1.0, True), (1.8, False)):
            scrub(seconds)
            path = ["meshcat", "run", "contact", "shaft", "<object>"]
            assert page.evaluate("(path) => viewer.scene_tree.find(path).object.visible", path) == seen
        live.play(run)
        page.wait_for_function("!viewer.scene_tree.find(['meshcat', 'run']).children.wall")
        live.play(run, wall=wall)
        page.wait_for_function("viewer.scene_tree.find(['meshcat', 'run']).children.wall")
    assert page.errors == []
