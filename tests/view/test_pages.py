"""Pages and scenes without a browser."""

import re
import socket
import subprocess

import numpy as np
import pinocchio as pin
import pytest
import umsgpack

import k1607_pin as k1607
from k1607_pin import view
from k1607_pin.view import camera
from k1607_pin.view.collada_mesh import collada_mesh
from k1607_pin.view.motion import keyframes
from k1607_pin.view.offline import Recorder, anonymous
from k1607_pin.view.scene import Scene
from k1607_pin.view.triads import triad

BENT = np.radians([20, -30, 10, 80, 0, 60, 0])


@pytest.fixture(scope="module")
def arm():
    return k1607.load_k1607()


def commands(window):
    return {key: umsgpack.unpackb(data) for key, data in window._commands.items()}


def test_a_page_needs_no_socket_and_no_process(arm, tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise AssertionError("a page must not need this")

    monkeypatch.setattr(socket, "socket", refuse)
    monkeypatch.setattr(subprocess, "Popen", refuse)
    path = view.save_html(arm, tmp_path / "new" / "arm.html", [0.0, 1.0], np.stack([np.zeros(7), BENT]))
    text = path.read_text()
    assert text.startswith("<!DOCTYPE html>")
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:)""", text.split("MeshCat.Viewer(document")[1])


def test_the_same_drawing_gives_the_same_page(arm):
    pages = {view.html(arm, [0.0, 1.0], np.stack([np.zeros(7), BENT])) for _ in range(2)}
    assert len(pages) == 1


def test_a_page_tells_neither_the_time_nor_the_network_address_of_the_machine(arm):
    """meshcat names its objects by UUIDs of version 1, made of these two."""
    window = Recorder()
    Scene(arm, window).display(BENT)
    recorded = b"".join(window._commands.values())
    identifier = re.compile(rb"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")
    before = [found[0] for found in identifier.finditer(recorded)]
    after = [found[0] for found in identifier.finditer(anonymous(recorded))]
    assert len(set(before)) == len(set(after)) > 50
    assert [before.index(x) for x in before] == [after.index(x) for x in after]
    assert all(x.startswith(b"00000000-0000-1000-8000-") for x in after)


def test_the_title_is_escaped(arm):
    assert "<title>a &lt;b&gt; &amp; c</title>" in view.html(arm, title="a <b> & c")


def test_the_page_carries_the_viewers_licences(arm):
    assert "@license" in view.html(arm).split("webpack")[0]


def test_sizes(arm):
    assert len(view.html(arm, Q=BENT)) < 1_000_000
    assert len(view.html(arm, np.linspace(0, 10, 10_000), np.linspace(0, 1, 10_000)[:, None] * BENT)) < 1_250_000


def test_notebook_returns_an_iframe_with_the_page(arm):
    from IPython.display import HTML

    cell = view.notebook(arm, Q=BENT, height=300)
    assert isinstance(cell, HTML)
    assert cell.data.count('"') == 4  # the page's own quotation marks are escaped
    assert "height: 300px" in cell.data


def test_what_is_drawn_twice_is_recorded_once_and_what_is_deleted_is_gone(arm):
    window = Recorder()
    scene = Scene(arm, window)
    scene.display(BENT)
    count = len(window._commands)
    scene.display(np.zeros(7))
    assert len(window._commands) == count
    scene.viewer["arm"].delete()
    assert not [key for key in window._commands if key[1].startswith("/meshcat/arm")]
    assert [key for key in window._commands if key[1].startswith("/meshcat/frames")]


def test_frames_are_the_arms_frames(arm):
    window = Recorder()
    Scene(arm, window).display(BENT)
    sent = commands(window)
    expected = [pin.SE3.Identity(), *arm.frames(BENT)]
    for i, placement in enumerate(expected):
        matrix = np.reshape(sent["set_transform", f"/meshcat/frames/{i}", None]["matrix"], (4, 4)).T
        np.testing.assert_allclose(matrix, placement.homogeneous, atol=1e-12)
    assert ("set_transform", "/meshcat/frames/tool", None) not in sent  # it is frame {7}


def test_a_tool_apart_from_the_last_joint_has_a_frame_of_its_own():
    panda, window = k1607.load_example("panda"), Recorder()
    q = np.array([0.3, -0.4, 0.1, -2.0, 0.2, 1.7, 0.8])
    Scene(panda, window).display(q)
    matrix = commands(window)["set_transform", "/meshcat/frames/tool", None]["matrix"]
    np.testing.assert_allclose(np.reshape(matrix, (4, 4)).T, panda.forward_kinematics(q).homogeneous, atol=1e-12)


def test_an_arm_without_geometry_shows_its_frames():
    bare, window = k1607.Arm(k1607.load_k1607().model, "tool"), Recorder()
    scene = Scene(bare, window)
    scene.display(BENT)
    scene.fit_camera(BENT)
    assert ("set_transform", "/meshcat/frames/7", None) in window._commands


def test_colours_of_a_triad():
    mesh = triad(0.2)
    vertices, colours = mesh.geometry.vertices, mesh.geometry.color
    for axis in range(3):
        tip = np.isclose(vertices[:, axis], 0.2)
        assert tip.sum() == 4
        assert (colours[tip].argmax(axis=1) == axis).all()


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_a_collada_mesh_is_where_pinocchio_has_it(name):
    for part in k1607.load_example(name).visual_model.geometryObjects:
        mine, theirs = collada_mesh(part.meshPath).geometry.vertices, part.geometry.vertices()
        np.testing.assert_allclose(mine.min(axis=0), theirs.min(axis=0), atol=1e-6)
        np.testing.assert_allclose(mine.max(axis=0), theirs.max(axis=0), atol=1e-6)


def test_a_collada_mesh_keeps_all_of_its_materials():
    """The viewer's own reader shows only the blue cap of this part, and not the dark housing and its grey ring."""
    part = k1607.load_example("ur5").visual_model.geometryObjects[1]
    assert len(np.unique(collada_mesh(part.meshPath).geometry.color, axis=0)) == 3


def test_the_camera_sees_every_point_and_goes_no_farther_than_it_must():
    points = np.random.default_rng(1).normal(size=(200, 3)) * [1.0, 0.3, 2.0] + [4.0, -3.0, 7.0]
    centre, eye = camera.fit(points)
    back = (eye - centre) / np.linalg.norm(eye - centre)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    depth = (eye - points) @ back
    height = np.abs((points - eye) @ up) / depth / np.tan(np.radians(camera.FIELD_OF_VIEW / 2))
    width = np.abs((points - eye) @ right) / depth / np.tan(np.radians(camera.FIELD_OF_VIEW / 2))
    assert depth.min() > 0
    assert 0.85 < max(height.max(), width.max()) < 1.0


def test_keyframes_keep_the_ends_and_interpolate_the_angles():
    times, Q = np.array([3.0, 4.0, 6.05]), np.array([[0.0, 1.0], [1.0, 0.0], [5.0, 0.0]])
    seconds, angles = keyframes(times, Q)
    assert seconds[0] == 0.0
    assert seconds[-1] == pytest.approx(3.05)
    assert np.diff(seconds).max() <= 1 / 30 + 1e-12
    np.testing.assert_allclose(angles[[0, -1]], Q[[0, -1]])
    np.testing.assert_allclose(angles[:, 0], np.interp(seconds + 3.0, times, Q[:, 0]))


@pytest.mark.parametrize(
    ("times", "Q", "message"),
    [
        (None, np.zeros(6), r"q: expected \(7,\) finite numbers in rad, got \[0.0"),
        (None, np.zeros((2, 7)), r"q: expected \(7,\) .* got shape \(2, 7\)"),
        (None, np.full(7, np.nan), r"q: expected \(7,\) finite numbers in rad, got \[nan"),
        (None, "bent", "q: expected numbers, got 'bent'"),
        ([0.0, 1.0], np.zeros((3, 7)), r"Q: expected \(2, 7\) .* got shape \(3, 7\)"),
        ([0.0, 1.0], np.full((2, 7), np.inf), r"Q: expected \(2, 7\) .* not all finite"),
        ([0.0, 1.0], None, r"Q: expected \(2, 7\) finite numbers in rad, got nothing"),
        ([0.0, 0.0], np.zeros((2, 7)), "times: expected increasing numbers in s, got 0.0 s and then 0.0 s"),
        ([0.0, np.nan], np.zeros((2, 7)), "times: expected .*finite"),
        ([0.0], np.zeros((1, 7)), "times: .* at least two"),
        ([[0.0, 1.0]], np.zeros((2, 7)), r"times: expected \(N,\)"),
    ],
)
def test_bad_input_says_what_was_expected(arm, tmp_path, times, Q, message):
    with pytest.raises(ValueError, match=message):
        view.save_html(arm, tmp_path / "arm.html", times, Q)
    assert list(tmp_path.iterdir()) == []
