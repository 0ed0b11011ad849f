"""Frames show what happens: motion moves the picture, tension colours the cable, slack is seen."""

import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import heave_env.scenarios
from heave_env.render import (
    FRAME_HEIGHT,
    FRAME_WIDTH,
    FrameData,
    HumanWindow,
    ansi_frame,
    draw_frame,
    tension_color,
)

STATIC_TENSION = 98.6e3
CABLE_COLUMN = slice(234, 239)  # where the cable hangs in the picture [px]
SCENE_WIDTH = 380  # the traces lie to the right of it [px]


def frame_data(**changes):
    """A taut 900 m cable after 60 s of a regular sea, the payload moving a tenth of the boom tip."""
    time = np.arange(0.0, 60.05, 0.1)
    boom_tip = 0.8 * np.sin(0.7 * time)
    usual = {
        "scenario_name": "sea_state_5",
        "time": 60.0,
        "boom_tip_heave": float(boom_tip[-1]),
        "winch_displacement": -0.9 * float(boom_tip[-1]),
        "payload_heave": 0.1 * float(boom_tip[-1]),
        "command": -0.95 * float(boom_tip[-1]),
        "length": 900.0,
        "node_tension": np.linspace(1.0, 0.5, 21) * STATIC_TENSION,
        "static_tension": STATIC_TENSION,
        "trace_time": time,
        "trace_boom_tip": boom_tip,
        "trace_payload": 0.1 * boom_tip,
    }
    return FrameData(**{**usual, **changes})


def linear_data(**changes):
    return frame_data(length=0.0, node_tension=None, static_tension=0.0, **changes)


def is_close(picture, color):
    return np.all(np.abs(picture.astype(int) - np.array(color)) <= 12, axis=-1)


def payload_rows(picture):
    """Rows in which the payload's yellow shows [px]."""
    return np.flatnonzero(is_close(picture[:, :SCENE_WIDTH], (250, 204, 60)).sum(axis=1) > 8)


@pytest.mark.parametrize("data", [frame_data(), linear_data()], ids=["cable", "linear"])
def test_a_frame_is_a_picture_of_the_stated_size(data):
    picture = draw_frame(data)
    assert picture.shape == (FRAME_HEIGHT, FRAME_WIDTH, 3)
    assert picture.dtype == np.uint8
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 500


def test_the_same_data_draw_the_same_picture_in_a_buffer_of_its_own():
    first, second = draw_frame(frame_data()), draw_frame(frame_data())
    np.testing.assert_array_equal(first, second)
    assert not np.shares_memory(first, second)


@pytest.mark.parametrize("make", [frame_data, linear_data])
def test_a_payload_that_rises_is_drawn_higher(make):
    low, high = (payload_rows(draw_frame(make(payload_heave=heave))) for heave in (-0.5, 0.5))
    # ±0.5 m of a range of 1 m that has 22 px: 22 px in all; rows are whole pixels.
    assert low[0] - high[0] == pytest.approx(22, abs=1)


def test_the_boom_tip_moves_the_vessel():
    low, high = (draw_frame(frame_data(boom_tip_heave=heave)) for heave in (-0.8, 0.8))
    orange = [
        np.flatnonzero(is_close(p[:150, :SCENE_WIDTH], (236, 148, 52)).any(axis=1)) for p in (low, high)
    ]
    assert orange[0][0] - orange[1][0] == pytest.approx(1.6 * 22, abs=2)


def test_the_winch_turns_its_drum():
    still, turned = (draw_frame(frame_data(winch_displacement=u, motion_range=1.0)) for u in (0.0, 0.8))
    drum = np.s_[95:140, 100:136]
    assert np.any(still[drum] != turned[drum])


def test_tension_runs_from_blue_through_pale_to_red():
    none, static, double = tension_color(0.0), tension_color(1.0), tension_color(2.0)
    assert none[2] > none[0] + 100
    assert min(static) > 200
    assert double[0] > double[2] + 100
    assert tension_color(7.0) == double
    assert tension_color(float("nan")) == none


@pytest.mark.parametrize("ratio", [0.2, 1.8])
def test_the_cable_wears_the_colour_of_its_tension(ratio):
    picture = draw_frame(frame_data(node_tension=np.full(21, ratio * STATIC_TENSION)))
    assert is_close(picture[200:370, CABLE_COLUMN], tension_color(ratio)).sum() > 150


def test_a_slack_cable_is_grey_and_wavy():
    taut = draw_frame(frame_data())
    tension = np.linspace(1.0, 0.5, 21) * STATIC_TENSION
    tension[10:] = 0.0
    slack = draw_frame(frame_data(node_tension=tension))
    beside = np.s_[260:380, 228:234]  # the taut cable leaves these pixels to the water
    assert not is_close(taut[beside], (150, 158, 168)).any()
    assert is_close(slack[beside], (150, 158, 168)).any()


@pytest.mark.parametrize("empty", [True, False])
def test_what_is_missing_or_not_finite_is_drawn_all_the_same(empty):
    trace = np.zeros(0) if empty else np.full(601, np.nan)
    time = np.zeros(0) if empty else np.arange(601) * 0.1
    data = frame_data(
        payload_heave=float("nan"),
        boom_tip_heave=float("inf"),
        trace_time=time,
        trace_boom_tip=trace,
        trace_payload=trace,
        node_tension=np.full(21, np.nan),
    )
    assert draw_frame(data).shape == (FRAME_HEIGHT, FRAME_WIDTH, 3)
    assert "sea_state_5" in ansi_frame(data)


def test_a_given_range_of_motion_fixes_the_scale():
    calm = frame_data(motion_range=3.0, trace_boom_tip=np.zeros(601), trace_payload=np.zeros(601))
    assert calm.largest_heave == frame_data(motion_range=3.0).largest_heave == 5.0


@settings(max_examples=25, deadline=None)
@given(
    heave=st.floats(-1e6, 1e6),
    payload=st.floats(-1e6, 1e6),
    winch=st.floats(-40.0, 40.0),
    length=st.floats(50.0, 1e4),
    tension=st.floats(-1e9, 1e9),
)
def test_whatever_happens_can_be_drawn_and_told(heave, payload, winch, length, tension):
    data = frame_data(
        boom_tip_heave=heave,
        payload_heave=payload,
        winch_displacement=winch,
        length=length,
        node_tension=np.full(21, tension),
    )
    assert data.largest_heave >= max(abs(heave), abs(payload)) * (1.0 - 1e-6)
    assert draw_frame(data).shape == (FRAME_HEIGHT, FRAME_WIDTH, 3)
    assert len(ansi_frame(data).splitlines()) == 8


def test_rounding_errors_in_a_calm_sea_are_not_blown_up():
    dust = 1e-12 * np.sin(np.arange(601))
    calm = frame_data(boom_tip_heave=0.0, payload_heave=dust[-1], trace_boom_tip=dust, trace_payload=dust)
    assert calm.largest_heave == 0.01
    still = frame_data(
        boom_tip_heave=0.0, payload_heave=0.0, trace_boom_tip=0.0 * dust, trace_payload=0.0 * dust
    )
    difference = np.abs(draw_frame(calm)[:330].astype(int) - draw_frame(still)[:330])
    assert (
        difference.mean() < 0.2
    )  # joints of a line that is not quite straight; a blown-up trace gives 1 and more


def test_text_names_every_quantity_with_its_unit():
    text = ansi_frame(frame_data(payload_heave=-0.0123))
    assert "t = 60.0 s" in text
    assert "-0.0123 m" in text
    assert "+98.60 kN" in text
    assert "taut" in text
    assert "slack" in ansi_frame(frame_data(node_tension=np.zeros(21)))
    assert "pushed" in ansi_frame(frame_data(node_tension=np.full(21, -5e3)))
    assert "tension" not in ansi_frame(linear_data())


def test_a_window_shows_frames_closes_twice_and_stays_closed_for_its_user(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame = pytest.importorskip("pygame")
    window = HumanWindow(fps=500.0)
    assert not window.is_open
    picture = draw_frame(frame_data())
    window.show(picture)
    assert window.is_open
    shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    np.testing.assert_array_equal(shown, picture)
    window.close()
    window.close()
    assert not window.is_open
    window.show(picture)
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    window.show(picture)
    assert not window.is_open
    window.show(picture)
    assert not window.is_open


@pytest.mark.parametrize("name", heave_env.scenarios.names())
def test_every_scenario_can_be_looked_at(name):
    scenario = heave_env.scenarios.load(name)
    env = gym.make(scenario.environment_id, render_mode="rgb_array")
    env.reset(seed=3)
    first = env.render()
    for _ in range(20):
        env.step(np.ones(1, dtype=np.float32))
    later = env.render()
    env.close()
    assert first.shape == later.shape == (FRAME_HEIGHT, FRAME_WIDTH, 3)
    assert first.dtype == later.dtype == np.uint8
    assert np.any(first != later)


def test_a_batch_gives_a_frame_per_row_or_a_text_per_row():
    for mode, kind in (("rgb_array", np.ndarray), ("ansi", str)):
        envs = gym.make_vec("heave_env/sea_state_5-v0", num_envs=3, render_mode=mode)
        envs.reset(seed=3)
        frames = envs.render()
        envs.close()
        assert [type(frame) for frame in frames] == [kind] * 3


def test_a_person_sees_a_window_that_follows_the_steps(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame = pytest.importorskip("pygame")
    env = gym.make("heave_env/sea_state_5-v0", render_mode="human")
    env.reset(seed=3)
    before = pygame.surfarray.array3d(pygame.display.get_surface()).copy()
    env.step(np.ones(1, dtype=np.float32))
    after = pygame.surfarray.array3d(pygame.display.get_surface()).copy()
    assert env.render() is None
    env.close()
    assert np.any(before != after)
    assert not pygame.display.get_init()


def test_making_an_environment_that_can_draw_loads_nothing_to_draw_with():
    code = """
import sys
import gymnasium
import heave_env
import heave_env.render
gymnasium.make("heave_env/sea_state_5-v0", render_mode="rgb_array").reset()
sys.exit("PIL" in sys.modules or "pygame" in sys.modules)
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
