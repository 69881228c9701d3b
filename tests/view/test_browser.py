"""What a person sees: the pages opened in Chromium, and judged by their pixels."""

from urllib.parse import urlsplit

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin import view

ARM = "meshcat/arm/visuals"
FRAMES = "meshcat/frames"
BENT = np.radians([20, -30, 10, 80, 0, 60, 0])
POSES = {
    "k1607": BENT,
    "panda": np.array([0.0, -0.4, 0.0, -2.0, 0.0, 1.7, 0.8]),
    "ur5": np.array([0.0, -1.2, 1.4, -1.6, -1.57, 0.0]),
    "xarm7": np.array([0.0, -0.4, 0.0, 1.0, 0.0, 1.2, 0.0]),  # STL meshes, where the others have COLLADA
}
HUES = {"roll": (0.53, 0.69), "tool": (0.04, 0.12)}  # the blue drums and the orange plate


def load(name):
    return k1607.load_k1607() if name == "k1607" else k1607.load_example(name)


def open_page(page, path):
    page.goto(path.as_uri())
    page.evaluate("drawn")


def hue_and_saturation(pixels):
    import matplotlib.colors

    hsv = matplotlib.colors.rgb_to_hsv(pixels / 255)
    return hsv[..., 0], hsv[..., 1]


@pytest.mark.parametrize("name", POSES)
def test_the_saved_page_shows_the_arm_offline(name, page, pixels_of, shown, tmp_path):
    path = view.save_html(load(name), tmp_path / "arm.html", Q=POSES[name], frames=False)
    page.context.set_offline(True)
    open_page(page, path)
    mask = pixels_of(ARM)
    assert shown(mask)
    assert page.errors == []
    assert {urlsplit(url).scheme for url in page.requested} <= {"file", "data", "blob"}


def test_the_check_fails_where_no_arm_is(page, pixels_of, shown, tmp_path):
    open_page(page, view.save_html(k1607.load_k1607(), tmp_path / "arm.html", Q=BENT))
    assert not shown(pixels_of(FRAMES))  # thin lines all over
    page.evaluate("viewer.delete_path(['meshcat', 'arm', 'visuals'])")
    assert not shown(pixels_of(ARM))


def test_the_browser_refuses_the_page_any_request(page, tmp_path):
    open_page(page, view.save_html(k1607.load_k1607(), tmp_path / "arm.html"))
    assert page.evaluate("fetch('http://127.0.0.1:9/').then(() => 'sent', (error) => 'refused')") == "refused"
    assert not [url for url in page.requested if url.startswith("http")]


def test_the_parts_have_their_colours(page, picture, pixels_of, tmp_path):
    open_page(page, view.save_html(k1607.load_k1607(), tmp_path / "arm.html", Q=BENT, frames=False))
    mask = pixels_of(ARM)
    hue, saturation = hue_and_saturation(picture()[mask])
    for part, (low, high) in HUES.items():
        assert np.mean((hue > low) & (hue < high) & (saturation > 0.4)) > 0.004, part
    bright = picture()[mask].min(axis=1) > 150
    assert bright.mean() > 0.1  # the pale bodies


def test_frames_can_be_switched(page, pixels_of, picture, switch, differ, tmp_path):
    open_page(page, view.save_html(k1607.load_k1607(), tmp_path / "on.html", Q=BENT))
    frames = pixels_of(FRAMES).sum()
    assert frames > 1000
    switch(FRAMES, False)
    hidden = picture()
    open_page(page, view.save_html(k1607.load_k1607(), tmp_path / "off.html", Q=BENT, frames=False))
    assert differ(hidden, picture()).sum() < 0.01 * frames


def test_a_motion_plays_in_real_time_and_can_be_scrubbed(page, picture, switch, differ, shown, tmp_path):
    times, Q = np.array([5.0, 7.0, 9.0]), np.stack([np.zeros(7), BENT, np.zeros(7)])
    open_page(page, view.save_html(k1607.load_k1607(), tmp_path / "arm.html", times, Q, frames=False))
    assert page.evaluate("viewer.animator.duration") == pytest.approx(4.0)

    # Read the viewer's time at each picture: between two of them, on a busy machine, it stands for most of a second.
    seen = page.evaluate(
        """() => new Promise((done) => {
            const animator = viewer.animator, update = animator.update.bind(animator), seen = [];
            animator.update = () => {
                update();
                seen.push([animator.clock.oldTime / 1000, animator.time]);  // the clock as this update read it
                if (seen.length > 8 && seen.at(-1)[0] - seen[0][0] > 1) done(seen);
            };
        })"""
    )
    clock, played = np.array(seen).T
    assert np.ptp(np.unwrap(played, period=4.0)) == pytest.approx(np.ptp(clock), rel=1e-3)

    page.evaluate("viewer.animator.pause()")
    switch(ARM, False)
    empty = picture()
    switch(ARM, True)
    seen = {}
    for seconds in (0.0, 1.0, 2.0):
        page.evaluate("(t) => viewer.animator.time_scrubber.setValue(t)", seconds)  # what the slider does
        seen[seconds] = picture()
        assert shown(differ(seen[seconds], empty))
    assert differ(seen[0.0], seen[1.0]).mean() > 0.02
    assert differ(seen[1.0], seen[2.0]).mean() > 0.02
    page.evaluate("viewer.animator.time_scrubber.setValue(0)")
    assert differ(seen[0.0], picture()).mean() < 0.001


def test_links_move_on_arcs_between_far_poses(page, tmp_path):
    """Two poses only: half way the parts are where the arm has them, not on the straight line between."""
    arm = k1607.load_k1607()
    turned = np.array([np.pi, -1.0, 0, 0, 0, 0, 0])
    start, half = turned * [0, 1, 1, 1, 1, 1, 1], turned * [0.5, 1, 1, 1, 1, 1, 1]
    open_page(page, view.save_html(arm, tmp_path / "arm.html", [0.0, 2.0], np.stack([start, turned])))
    page.evaluate("viewer.animator.pause(); viewer.animator.seek(1.0)")
    shown_at = page.evaluate("viewer.scene_tree.find(['meshcat', 'frames', '7']).object.position.toArray()")
    assert shown_at == pytest.approx(arm.forward_kinematics(half).translation, abs=1e-6)


def test_the_notebook_cell_shows_the_arm(page, browser, tmp_path):
    cell = view.notebook(k1607.load_k1607(), Q=BENT, frames=False, height=400)
    page.set_content(f"<html><body>{cell.data}</body></html>")
    frame = page.frames[1]
    frame.evaluate("drawn")
    assert frame.evaluate("viewer.scene_tree.find(['meshcat', 'arm', 'visuals']).object.children.length") >= 20
    assert page.errors == []
    assert page.locator("iframe").bounding_box()["height"] == 400


def test_the_live_viewer_shows_the_arm_and_follows_it(page, picture, pixels_of, shown, differ):
    arm = k1607.load_k1607()

    def wait_for(q):
        page.wait_for_function(
            """([x, y, z]) => {
                const tool = viewer.scene_tree.find(["meshcat", "frames", "7"]).object.position;
                return viewer.camera.position.length() > 0 && viewer.camera.fov < 40  // what a new page is sent last
                    && Math.hypot(tool.x - x, tool.y - y, tool.z - z) < 1e-6;
            }""",
            arg=arm.forward_kinematics(q).translation.tolist(),
        )

    with view.show(arm, Q=BENT, frames=False) as live:
        page.goto(live.url)
        wait_for(BENT)
        assert shown(pixels_of(ARM))
        bent = picture()
        live.display(np.zeros(7))
        wait_for(np.zeros(7))
        assert differ(bent, picture()).mean() > 0.02

        live.play([0.0, 1.0], np.stack([np.zeros(7), BENT]))
        page.wait_for_function("viewer.animator.actions.length > 0")
        live.display(BENT)
        page.wait_for_function("viewer.animator.actions.length == 0")
        wait_for(BENT)
    assert {urlsplit(url).hostname for url in page.requested} == {"127.0.0.1"}
    assert page.errors == []
