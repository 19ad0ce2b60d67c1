"""The top view: what it shows, where, and how it behaves without pygame or display."""

import math
import sys
import time

import gymnasium as gym
import numpy as np
import pytest

from youbot_env.envs.camera import PADDING, Camera, round_length
from youbot_env.envs.drawing import magnified
from youbot_env.envs.rendering import TORQUE, TopView
from youbot_env.envs.scene import (
    DRIVEN,
    EDGE,
    REFERENCE,
    SATURATED,
    RobotOutline,
    dashes,
    evenly,
    first_lap,
    on_floor,
    upper_rollers,
)
from youbot_env.platform import omni3, youbot

pygame = pytest.importorskip("pygame")
PLATFORMS = (youbot(), omni3())
NOWHERE = np.empty((0, 2))


def circle(turns: float, radius: float = 0.8, points: int = 400) -> np.ndarray:
    angle = np.linspace(0.0, 2 * math.pi * turns, points)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def eight(points: int = 400) -> np.ndarray:
    angle = np.linspace(0.0, 2 * math.pi, points)
    return np.stack([1.2 * np.sin(angle), 0.8 * np.sin(2 * angle)], axis=-1)


def show(view: TopView, pose=(0, 0, 0), reference=(1, 0.5, 0.3), **changes):
    """Draw a frame of which only some things matter."""
    wheels = len(view.platform.wheels)
    scene = {
        "path": NOWHERE,
        "reference_path": NOWHERE,
        "torque": np.zeros(wheels),
        "torque_limit": 8.0,
        "caption": "t = 0 s",
    } | changes
    return view.draw(np.array(pose, float), np.array(reference, float), **scene)


def is_colour(image: np.ndarray, colour: tuple) -> np.ndarray:
    return (np.abs(image.astype(int) - colour) <= 2).all(axis=-1)


def pixel_of(view: TopView, point) -> tuple[int, int]:
    """Column and row of a floor point in the whole picture."""
    x, y = view._scene.camera.project(np.array(point, float)) + view._view.topleft
    return int(x), int(y)


@pytest.mark.parametrize("platform", PLATFORMS, ids=lambda p: p.name)
@pytest.mark.parametrize("size", [(720, 540), (640, 480), (1001, 777)])
def test_picture_needs_no_display(platform, size):
    pygame.display.quit()
    view = TopView(platform, "rgb_array", 25.0, size)
    image = show(view, torque_limit=math.inf, path=circle(0.3), reference_path=circle(1))
    assert image.shape == (size[1], size[0], 3)
    assert image.dtype == np.uint8
    assert not pygame.display.get_init()
    assert is_colour(image, DRIVEN).sum() > 50
    assert is_colour(image, REFERENCE).sum() > 100


def test_pictures_are_independent_and_repeatable():
    view = TopView(youbot(), "rgb_array", 25.0)
    first = show(view)
    kept = first.copy()
    assert not np.array_equal(show(view, pose=(0.3, 0.1, 0.5)), first)
    assert np.array_equal(first, kept)
    assert np.array_equal(show(TopView(youbot(), "rgb_array", 25.0)), kept)


def test_centres_lie_where_the_floor_says():
    view = TopView(youbot(), "rgb_array", 25.0)
    image = show(view, pose=(-0.4, 0.6, 1.0), reference=(0.7, -0.5, 0.0))
    (x, y), (xr, yr) = pixel_of(view, (-0.4, 0.6)), pixel_of(view, (0.7, -0.5))
    assert x < xr
    assert y < yr
    assert is_colour(image[y, x], EDGE)
    assert is_colour(image[yr, xr], REFERENCE)


def test_heading_mark_points_forward():
    view = TopView(youbot(), "rgb_array", 25.0)
    for yaw in (0.0, math.pi / 2, -2.5):
        image = show(view, pose=(0, 0, yaw), reference=(1.4, 1.4, 0))
        ahead, behind = (
            pixel_of(view, on_floor(np.array([side * 0.235, 0.0]), np.array([0, 0, yaw])))
            for side in (1, -1)
        )
        assert is_colour(image[ahead[1], ahead[0]], EDGE)
        assert not is_colour(image[behind[1], behind[0]], EDGE)


@pytest.mark.parametrize("platform", PLATFORMS, ids=lambda p: p.name)
def test_drawn_rollers_obey_the_kinematics(platform):
    """Without slip the contact point moves only across the axis of the roller on the floor."""
    rng = np.random.default_rng(3)
    for wheel, row in zip(platform.wheels, platform.jacobian_array, strict=True):
        axes = upper_rollers(wheel.roller_angle, platform.wheel_radius, 0.7 * platform.wheel_radius)
        along = axes[0, 1] - axes[0, 0]
        on_floor_axis = along * (1, -1)  # half a turn about the wheel axis
        v = rng.normal(size=3)
        centre = v[:2] + v[2] * np.array([-wheel.y, wheel.x])
        c, s = math.cos(wheel.heading), math.sin(wheel.heading)
        u, w = c * centre[0] + s * centre[1], -s * centre[0] + c * centre[1]
        slip = np.array([u - platform.wheel_radius * row @ v, w])
        assert slip @ on_floor_axis == pytest.approx(0.0, abs=1e-12)


def test_youbot_rollers_form_an_x_from_above():
    outline = RobotOutline.of(youbot())
    for wheel, axes in zip(youbot().wheels, outline.rollers, strict=True):
        along = axes[:, 1] - axes[:, 0]
        assert (np.sign(along[:, 0] * along[:, 1]) == np.sign(wheel.x * wheel.y)).all()


@pytest.mark.parametrize("platform", PLATFORMS, ids=lambda p: p.name)
def test_footprint_holds_the_wheels(platform):
    outline = RobotOutline.of(platform)
    edges = np.roll(outline.body, -1, axis=0) - outline.body
    for wheel, shape, axes in zip(platform.wheels, outline.wheels, outline.rollers, strict=True):
        offset = shape[:, None] - outline.body
        assert (edges[:, 0] * offset[..., 1] - edges[:, 1] * offset[..., 0] > 0).all()
        place = np.array([wheel.x, wheel.y])
        assert shape.mean(axis=0) == pytest.approx(place, abs=1e-9)
        assert np.hypot(*(shape - place).T).max() >= platform.wheel_radius
        assert np.hypot(*(axes - place).reshape(-1, 2).T).max() < 1.2 * platform.wheel_radius


def test_bars_show_sign_size_and_saturation():
    view = TopView(youbot(), "rgb_array", 25.0)
    image = show(view, torque=np.array([2.0, -4.0, 8.0, 0.0]), torque_limit=8.0)
    panel = image[: view._panel._box.centery, view._panel._box.left :]
    middle = view._panel._box.centerx - view._panel._box.left
    blue = is_colour(panel, TORQUE)
    right, left = (side.any(axis=0).sum() for side in (blue[:, middle:], blue[:, :middle]))
    assert left == pytest.approx(2 * right, abs=3)
    full = is_colour(panel, SATURATED)[:, : middle + 4 * right + 5]
    assert full[:, middle:].any(axis=0).sum() == pytest.approx(4 * right, abs=6)
    assert not full[:, :middle].any()


def test_saturated_wheel_is_marked_on_the_robot():
    view = TopView(youbot(), "rgb_array", 25.0)
    torque = np.array([0.0, 0.0, -8.0, 0.0])
    image = show(view, torque=torque, reference=(0, 0, 0))
    rows, columns = np.nonzero(is_colour(image[:, : view._view.right], SATURATED))
    wheel = youbot().wheels[2]
    expected = pixel_of(view, (wheel.x, wheel.y))
    assert np.median(columns) == pytest.approx(expected[0], abs=6)
    assert np.median(rows) == pytest.approx(expected[1], abs=6)
    assert not is_colour(
        show(view, torque=0.99 * torque, reference=(0, 0, 0))[:, : view._view.right], SATURATED
    ).any()


def test_path_grown_frame_by_frame_looks_like_one_drawn_at_once():
    path, reference = circle(0.8, 0.75), circle(1)
    grown, once = (TopView(youbot(), "rgb_array", 25.0) for _ in range(2))
    for k in range(2, len(path) + 1, 6):
        last = show(grown, pose=(*path[k - 1], 0), path=path[:k], reference_path=reference)
    for _ in range(2):  # the second frame is drawn at rest
        full = show(once, pose=(*path[k - 1], 0), path=path[:k], reference_path=reference)
    differs = np.abs(last.astype(int) - full).max(axis=-1) > 60
    assert is_colour(full, DRIVEN).sum() > 400
    assert differs.sum() < 0.05 * is_colour(full, DRIVEN).sum()


def test_shorter_path_after_reset_leaves_nothing_behind():
    reference = circle(1)
    view = TopView(youbot(), "rgb_array", 25.0)
    show(view, path=circle(0.9, 0.7), reference_path=reference)
    image = show(view, path=NOWHERE, reference_path=reference)
    view_only = image[: view._view.bottom, : view._view.right]
    assert not is_colour(view_only, DRIVEN).any()


def test_view_rests_on_a_path_that_fits():
    camera = Camera(500, 450, 25.0)
    path = eight()
    seen = []
    for k in range(0, 400, 4):
        camera.follow(np.array([path[k] + 0.02 * math.sin(k), path[k]]), 0.35, path)
        seen.append((*camera.centre, camera.span))
    assert np.ptp(seen, axis=0) == pytest.approx(np.zeros(3))
    inside = camera.project(path)
    assert (inside > 0).all()
    assert (inside < camera.size).all()


def test_view_keeps_robot_and_reference_in_frame_without_jerks():
    camera = Camera(500, 450, 25.0)
    rng = np.random.default_rng(7)
    step = 0.8 / 25.0  # m a frame, the top speed of the youBot
    reference, robot, centres = np.zeros(2), np.zeros(2), []
    heading = rng.normal(size=(400, 2)).cumsum(axis=0)
    for drift in heading:
        reference = reference + step * drift / max(np.hypot(*drift), 1e-9)
        robot = robot + step * np.array([0.5, -0.2])
        camera.follow(np.array([robot, reference]), 0.35, NOWHERE)
        for body in (robot, reference):
            corners = camera.project(body + 0.35 * np.array([(-1, -1), (1, 1)]))
            assert (corners > -1e-6).all()
            assert (corners < camera.size + 1e-6).all()
        centres.append(camera.centre)
    moves = np.hypot(*np.diff(centres, axis=0).T)
    assert moves.max() < 8 * step
    assert np.hypot(*np.diff(centres, n=2, axis=0).T).max() < 4 * step


def test_view_jumps_after_a_reset_and_reaches_far():
    camera = Camera(500, 450, 25.0)
    camera.follow(np.zeros((2, 2)), 0.35, NOWHERE)
    camera.follow(np.array([(50.0, 20.0), (50.0, 20.5)]), 0.35, NOWHERE)
    assert camera.resting
    assert camera.centre == pytest.approx([50.0, 20.25], abs=0.3)
    camera.follow(np.array([(50.0, 20.0), (9050.0, 20.5)]), 0.35, NOWHERE)
    assert camera.extent[0] * PADDING >= 9000.7
    assert show(TopView(youbot(), "rgb_array", 25.0), reference=(9000, 1, 0)).any()


@pytest.mark.parametrize(("at_most", "length"), [(0.26, 0.2), (1.0, 1.0), (9.9, 5.0), (0.05, 0.05)])
def test_round_length(at_most, length):
    assert round_length(at_most) == pytest.approx(length)


def test_laps_are_cut_once():
    lap = first_lap(evenly(circle(3.2, points=2000), 0.02))
    assert np.hypot(*np.diff(lap, axis=0).T).sum() == pytest.approx(2 * math.pi * 0.8, abs=0.05)
    for path in (evenly(eight(), 0.02), evenly(circle(0.9), 0.02)):
        assert len(first_lap(path)) >= len(path) - 2
    loop_then_away = np.concatenate([circle(1), [(0.8, 3.0)]])
    path = evenly(loop_then_away, 0.02)
    assert len(first_lap(path)) == len(path)


def test_dashes_and_gaps():
    path = evenly(np.array([(0.0, 0.0), (3.0, 4.0)]), 0.1)
    cut = dashes(path, on=2, off=1)
    assert np.hypot(*(cut[:, -1] - cut[:, 0]).T) == pytest.approx(0.2)
    assert np.hypot(*(cut[1:, 0] - cut[:-1, -1]).T) == pytest.approx(0.1)
    assert len(dashes(evenly(np.ones((5, 2)), 0.1), on=2, off=1)) == 0


@pytest.mark.parametrize("factor", [2, 4])
def test_magnifying_changes_nothing_but_what_is_drawn(factor):
    surface = pygame.Surface((60, 50), 0, 32)
    noise = np.random.default_rng(0).integers(0, 256, (60, 50, 3), dtype=np.uint8)
    pygame.surfarray.blit_array(surface, noise)
    with magnified(pygame, surface, np.array([(10.0, 10.0), (40.0, 70.0)]), 3.0, factor) as brush:
        brush.fill(np.array([(20, 20), (24, 20), (24, 24), (20, 24.0)]), (255, 0, 0))
    after = pygame.surfarray.array3d(surface)
    touched = (after != noise).any(axis=-1)
    assert (after[20:24, 20:24] == (255, 0, 0)).all()
    touched[19:26, 19:26] = False
    assert not touched.any()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("youbot", 25.0), "'youbot'"),
        (("rgb_array", 0.0), "fps = 0.0"),
        (("rgb_array", 25.0, (100, 100)), "(480, 360)"),
    ],
)
def test_bad_construction_is_told(arguments, told):
    with pytest.raises(ValueError, match=r".+") as error:
        TopView(youbot(), *arguments)
    assert told in str(error.value)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"pose": (0, math.nan, 0)}, "pose[1] = nan"),
        ({"reference": (0, 0)}, "reference_pose has shape (2,)"),
        ({"path": np.zeros((4, 3))}, "path has shape (4, 3)"),
        ({"torque": np.zeros(3)}, "torque has shape (3,)"),
        ({"torque_limit": 0.0}, "torque_limit = 0.0"),
    ],
)
def test_bad_frames_are_told(changes, told):
    with pytest.raises(ValueError, match=r".+") as error:
        show(TopView(youbot(), "rgb_array", 25.0), **changes)
    assert told in str(error.value)


def test_missing_pygame_names_the_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(gym.error.DependencyNotInstalled, match="pip install pygame"):
        TopView(youbot(), "rgb_array", 25.0)


@pytest.fixture
def window(monkeypatch):
    pygame.quit()
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    view = TopView(youbot(), "human", 40.0, (480, 360))
    yield view
    view.close()
    pygame.quit()


def test_window_shows_the_picture_and_keeps_the_frame_rate(window):
    assert show(window) is None
    start = time.perf_counter()
    for _ in range(6):
        show(window)
    assert time.perf_counter() - start >= 5 / 40.0
    picture = show(TopView(youbot(), "rgb_array", 40.0, (480, 360)))
    on_screen = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    assert np.array_equal(on_screen, picture)


def test_closed_window_stays_closed(window):
    show(window)
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    assert show(window) is None
    assert not pygame.display.get_init()
    assert show(window) is None
    assert not pygame.display.get_init()


@pytest.fixture
def no_display(monkeypatch):
    pygame.quit()
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    yield monkeypatch
    pygame.quit()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a display is always there")
def test_a_driver_without_display_names_the_remedy(no_display):
    no_display.setenv("SDL_VIDEODRIVER", "x11")
    with pytest.raises(gym.error.Error, match="rgb_array"):
        show(TopView(youbot(), "human", 25.0))


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a display is always there")
def test_without_display_a_window_is_drawn_off_screen_and_logged(no_display, caplog):
    caplog.set_level("INFO")
    assert show(TopView(youbot(), "human", 25.0)) is None
    assert "off screen" in caplog.text


@pytest.mark.parametrize("again", [False, True])
def test_survives_other_code_quitting_pygame(again):
    view = TopView(youbot(), "rgb_array", 25.0)
    show(view)
    pygame.quit()
    if again:
        pygame.font.init()
    image = show(view, caption="a line not yet written")
    assert np.array_equal(
        image, show(TopView(youbot(), "rgb_array", 25.0), caption="a line not yet written")
    )
