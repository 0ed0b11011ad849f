"""A frame of vessel, boom tip, winch, cable and payload, with recent traces beside it.

Pictures are drawn with Pillow at twice their size and reduced, windows are opened with pygame; both are
imported when the first frame is drawn, so that an environment made with a render mode costs nothing until it
is looked at.

The picture is a diagram. Depth has one scale, heave another that is larger by the factor printed in it: boom
tip, winch and payload share that one, so a payload that stays on its dashed line is compensated. The sea's
surface is only drawn from the recent motion of the boom tip, travelling away from the vessel.
Where the tension is not positive the cable is drawn grey and wavy: it is slack or, if the scenario lets it
carry compression, pushed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled

FRAME_WIDTH = 640
"""Width of a frame [px]."""
FRAME_HEIGHT = 480
"""Height of a frame [px]."""
TRACE_WINDOW = 60.0
"""Time that the traces look back [s]."""

_SUPERSAMPLING = 2
_SCENE_WIDTH = 382
_WATERLINE = 152.0
_SHEAVE = (236.0, 92.0)
_DRUM = (118.0, 117.0)
_DRUM_RADIUS = 11.0
_DEEPEST = 424.0
_HEAVE_ROOM = 22.0  # largest heave in the picture [px]
_TROUGH = _WATERLINE + 2.0 * _HEAVE_ROOM + 1.0  # below every wave [px]
_WAVE_SPEED = 11.0  # of the drawn surface [px/s]
_NO_TENSION = 1.0  # tension of a slack cable, up to rounding [N]
_NOTHING = 1.0e-5  # motion that is not worth a scale of its own [m]

_Color = tuple[int, int, int]
_Point = tuple[float, float]

_SKY = ((196, 216, 228), (243, 236, 222))
_SEA = ((38, 104, 134), (9, 27, 48))
_PANEL = (13, 24, 38)
_PLOT = (20, 35, 53)
_GRID = (42, 61, 83)
_INK = (24, 38, 56)
_PALE = (214, 224, 234)
_MUTED = (137, 156, 177)
_BOOM_TIP = (245, 170, 66)
_PAYLOAD = (86, 205, 218)
_SLACK = (150, 158, 168)
_NEUTRAL = (226, 230, 234)
_TENSIONS = ((64, 120, 255), (238, 238, 228), (255, 66, 50))  # none, static, twice static


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameData:
    """What one frame shows, of one environment. Heave is positive up, winch displacement raises."""

    scenario_name: str
    """The scenario's name."""
    time: float
    """Time since the start of the episode [s]."""
    boom_tip_heave: float
    """Heave of the boom tip [m]."""
    winch_displacement: float
    """Displacement that the winch adds to the cable's top end [m]."""
    payload_heave: float
    """Heave of the payload about its still-water position [m]."""
    command: float
    """Commanded winch displacement [m]."""
    length: float = 0.0
    """Unstretched cable outboard [m]; zero for a linear payload, which has none."""
    node_tension: np.ndarray | None = None
    """Tension along the cable, sheave to payload [N], shape (n,); None for a linear payload."""
    static_tension: float = 0.0
    """Sheave tension hanging in still water [N]."""
    trace_time: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Times of the traces, increasing, up to `time` [s], shape (m,)."""
    trace_boom_tip: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Boom-tip heave at those times [m], shape (m,)."""
    trace_payload: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Payload heave at those times [m], shape (m,)."""
    motion_range: float | None = None
    """Heave that fills the room the picture has for it [m]; None: taken from the traces, in which case
    the scale changes when the sea does."""

    @property
    def largest_heave(self) -> float:
        """Heave that every motion shown fits within: 1, 2 or 5 times a power of ten, 0.01 at least [m]."""
        if self.motion_range is not None:
            return _rounded_up(self.motion_range)
        shown = [self.boom_tip_heave, self.payload_heave, *self.trace_boom_tip, *self.trace_payload]
        return _rounded_up(max([0.01, *(abs(value) for value in shown if math.isfinite(value))]))

    @property
    def still_length(self) -> float:
        """Unstretched length had the winch not moved: where the payload's still position is [m]."""
        return self.length + self.winch_displacement


def draw_frame(data: FrameData) -> np.ndarray:
    """Draws a frame.

    Args:
        data: What to show.

    Returns:
        Picture, uint8, shape (480, 640, 3).

    Raises:
        DependencyNotInstalled: Pillow is missing.
    """
    canvas = _scene_canvas(data)
    _draw_panel(canvas, data)
    return canvas.pixels()


def draw_scene(data: FrameData) -> np.ndarray:
    """Draws vessel, cable and payload without the panel beside them.

    Args:
        data: What to show.

    Returns:
        Picture, uint8, shape (480, 382, 3).

    Raises:
        DependencyNotInstalled: Pillow is missing.
    """
    return _scene_canvas(data).pixels()[:, :_SCENE_WIDTH]


def _scene_canvas(data: FrameData) -> _Canvas:
    canvas = _Canvas()
    scene = _Scene(data)
    _draw_sea(canvas, data, scene)
    _draw_vessel(canvas, scene)
    _draw_depths(canvas, data, scene)
    _draw_cable(canvas, data, scene)
    _draw_payload(canvas, data, scene)
    _draw_sheave(canvas, scene)
    _draw_tension_scale(canvas, data)
    _draw_caption(canvas, data, scene)
    return canvas


def ansi_frame(data: FrameData) -> str:
    """A frame as a few lines of text: bars for the motions, the payload's recent trace beneath."""
    room = data.largest_heave
    lines = [f"{data.scenario_name}   t = {data.time:.1f} s   bars ±{room:g} m"]
    for label, heave in (
        ("boom tip", data.boom_tip_heave),
        ("command", data.command),
        ("winch", data.winch_displacement),
        ("payload", data.payload_heave),
    ):
        lines.append(f"{label:<9}{heave:+10.4f} m  {_text_bar(heave / room)}")
    if data.node_tension is not None:
        tension = data.node_tension
        lowest = float(np.min(tension))
        state = "taut" if lowest > 0.0 else "slack" if lowest > -_NO_TENSION else "pushed"
        lines.append(f"{'tension':<9}{tension[0] / 1e3:+10.2f} kN at the sheave, {state}")
        lines.append(f"{'cable':<9}{data.length:+10.2f} m outboard")
    lines.append(f"{'history':<9}{_text_trace(data.trace_payload)}")
    return "\n".join(lines) + "\n"


class HumanWindow:
    """A window that shows frames at their own pace. Opens with the first frame."""

    def __init__(self, fps: float, title: str = "heave_env") -> None:
        """Remembers what to open.

        Args:
            fps: Most frames shown in a second [1/s].
            title: Text of the title bar.
        """
        self.fps = fps
        self.title = title
        self._screen: Any = None
        self._clock: Any = None
        self._is_dismissed = False

    @property
    def is_open(self) -> bool:
        """Whether there is a window; a user who closes it is not shown another."""
        return self._screen is not None

    def show(self, frame: np.ndarray) -> None:
        """Shows a frame of shape (height, width, 3), waiting until it is due."""
        if self._is_dismissed:
            return
        pygame = _pygame()
        if self._screen is None:
            pygame.display.init()
            pygame.display.set_caption(self.title)
            self._screen = pygame.display.set_mode((frame.shape[1], frame.shape[0]))
            self._clock = pygame.time.Clock()
        surface = pygame.image.frombuffer(np.ascontiguousarray(frame).tobytes(), frame.shape[1::-1], "RGB")
        self._screen.blit(surface, (0, 0))
        pygame.display.flip()
        self._clock.tick(self.fps)
        if any(event.type == pygame.QUIT for event in pygame.event.get()):
            self._is_dismissed = True
            self.close()

    def close(self) -> None:
        """Closes the window; closing twice is allowed."""
        if self._screen is not None:
            _pygame().display.quit()
            self._screen = self._clock = None


def tension_color(ratio: float) -> tuple[int, int, int]:
    """Colour of a cable at `ratio` of the static sheave tension: blue at 0, pale at 1, red from 2 on."""
    low, middle, high = (np.array(color, dtype=float) for color in _TENSIONS)
    ratio = min(max(ratio, 0.0), 2.0) if math.isfinite(ratio) else 0.0
    mixed = low + (middle - low) * ratio if ratio < 1.0 else middle + (high - middle) * (ratio - 1.0)
    return _as_color(mixed)


# The canvas --------------------------------------------------------------------------------------


class _Canvas:
    """Anti-aliased drawing in coordinates of the finished frame: x to the right, y down [px]."""

    def __init__(self) -> None:
        _, draw_module, _ = _pillow()
        self._image = _backdrop().copy()
        self._draw = draw_module.Draw(self._image)

    def pixels(self) -> np.ndarray:
        """The finished frame, uint8, shape (480, 640, 3)."""
        return np.array(self._image.reduce(_SUPERSAMPLING), dtype=np.uint8)

    def line(self, points: list[_Point], color: _Color, width: float = 1.0) -> None:
        """An open polyline."""
        pixels = max(1, round(width * _SUPERSAMPLING))
        self._draw.line([self._scaled(p) for p in points], fill=color, width=pixels, joint="curve")

    def dashes(self, start: _Point, end: _Point, color: _Color, dash: float = 4.0) -> None:
        """A dashed straight line."""
        span = math.dist(start, end)
        for begin in np.arange(0.0, span, 2.0 * dash):
            at = [
                (start[0] + (end[0] - start[0]) * s / span, start[1] + (end[1] - start[1]) * s / span)
                for s in (begin, min(begin + dash, span))
            ]
            self.line(at, color)

    def polygon(self, points: list[_Point], color: _Color) -> None:
        """A filled polygon."""
        self._draw.polygon([self._scaled(p) for p in points], fill=color)

    def box(self, corner: _Point, opposite: _Point, color: _Color, radius: float = 0.0) -> None:
        """A filled rectangle, its corners rounded by `radius`."""
        bounds = (*self._scaled(corner), *self._scaled(opposite))
        self._draw.rounded_rectangle(bounds, radius=radius * _SUPERSAMPLING, fill=color)

    def disc(self, center: _Point, radius: float, color: _Color) -> None:
        """A filled circle."""
        x, y = center
        bounds = (*self._scaled((x - radius, y - radius)), *self._scaled((x + radius, y + radius)))
        self._draw.ellipse(bounds, fill=color)

    def text(self, at: _Point, text: str, color: _Color, size: float = 11.0, anchor: str = "la") -> None:
        """Text whose `anchor` (Pillow's two letters) lies at the point."""
        font = _font(size * _SUPERSAMPLING)
        self._draw.text(self._scaled(at), text, fill=color, font=font, anchor=anchor)

    def _scaled(self, point: _Point) -> _Point:
        return point[0] * _SUPERSAMPLING, point[1] * _SUPERSAMPLING


def _pillow() -> tuple[Any, Any, Any]:
    try:
        from PIL import Image, ImageDraw, ImageFont
    except ImportError as error:
        raise DependencyNotInstalled(
            "Pillow draws the frames: install it with pip install 'heave-env[render]'"
        ) from error
    return Image, ImageDraw, ImageFont


def _pygame() -> Any:
    try:
        import pygame
    except ImportError as error:
        raise DependencyNotInstalled(
            "pygame-ce shows the window: install it with pip install 'heave-env[render]'"
        ) from error
    return pygame


@lru_cache(maxsize=16)
def _font(size: float) -> Any:
    return _pillow()[2].load_default(size)


@lru_cache(maxsize=1)
def _backdrop() -> Any:
    """What never changes, at the canvas's size: sky down to the deepest trough, sea below it, panel."""
    y = np.arange(FRAME_HEIGHT * _SUPERSAMPLING) / _SUPERSAMPLING
    sky, sea = _gradient(_SKY, y / _WATERLINE), _gradient(_SEA, (y - _TROUGH) / (FRAME_HEIGHT - _TROUGH))
    column = np.where(y[:, None] < _TROUGH, sky, sea)
    picture = np.repeat(column[:, None, :], FRAME_WIDTH * _SUPERSAMPLING, axis=1)
    picture[:, _SCENE_WIDTH * _SUPERSAMPLING :] = _PANEL
    return _pillow()[0].fromarray(np.round(picture).astype(np.uint8))


def _gradient(colors: tuple[_Color, _Color], share: np.ndarray) -> np.ndarray:
    """From the first colour where `share` is 0 to the second where it is 1, (n, 3)."""
    share = np.clip(share, 0.0, 1.0)[:, None]
    return (1.0 - share) * np.array(colors[0], dtype=float) + share * np.array(colors[1], dtype=float)


# The scene ---------------------------------------------------------------------------------------


class _Scene:
    """Where things are in the picture [px]."""

    def __init__(self, data: FrameData) -> None:
        self.pixels_per_metre = _HEAVE_ROOM / data.largest_heave
        self.lift = self.heave(data.boom_tip_heave)
        self.sheave = (_SHEAVE[0], _SHEAVE[1] - self.lift)
        self.depth_shown = (
            _rounded_up(1.05 * data.still_length, (1.0, 2.0, 3.0, 5.0)) if data.length > 0.0 else 0.0
        )
        self.still_y = self.depth(data.still_length) if self.depth_shown else 0.85 * _DEEPEST
        self.payload = (_SHEAVE[0], self.still_y - self.heave(data.payload_heave))
        # The mark on the drum moves as far as the cable does.
        self.drum_angle = self.pixels_per_metre * _finite(data.winch_displacement) / _DRUM_RADIUS

    def heave(self, metres: float) -> float:
        """Heave in the picture [px], within twice the room it should take."""
        return min(max(self.pixels_per_metre * _finite(metres), -2.0 * _HEAVE_ROOM), 2.0 * _HEAVE_ROOM)

    def depth(self, metres: float) -> float:
        """Height in the picture of what is so far below the boom tip's mean position [px]."""
        return _SHEAVE[1] + (_DEEPEST - _SHEAVE[1]) * metres / self.depth_shown


def _draw_sea(canvas: _Canvas, data: FrameData, scene: _Scene) -> None:
    x = np.arange(0.0, _SCENE_WIDTH + 1.0, 2.0)
    # Distance from the boom tip, rounded off at zero so that the surface has no kink there.
    away = np.hypot(x - _SHEAVE[0], 12.0) - 12.0
    heave = _recent_heave(data, data.time - away / _WAVE_SPEED)
    surface = [(float(at), _WATERLINE - scene.heave(float(h))) for at, h in zip(x, heave, strict=True)]
    canvas.polygon([*surface, (_SCENE_WIDTH, _TROUGH), (0.0, _TROUGH)], _SEA[0])
    canvas.line(surface, (178, 214, 224), 1.5)


def _recent_heave(data: FrameData, times: np.ndarray) -> np.ndarray:
    """Boom-tip heave at earlier times [m]; it fades to nothing within 4 s before the trace begins."""
    if len(data.trace_time) == 0:
        return np.full_like(times, _finite(data.boom_tip_heave))
    known = np.concatenate(([data.trace_time[0] - 4.0], data.trace_time))
    heave = np.concatenate(([0.0], np.nan_to_num(data.trace_boom_tip)))
    return np.interp(times, known, heave)


def _draw_vessel(canvas: _Canvas, scene: _Scene) -> None:
    def at(*points: _Point) -> list[_Point]:
        return [(x, y - scene.lift) for x, y in points]

    canvas.polygon(at((-5, 128), (186, 128), (180, 158), (-5, 158)), (35, 55, 80))
    canvas.polygon(at((-5, 157), (180, 157), (170, 177), (-5, 177)), (150, 52, 44))
    canvas.line(at((-5, 157), (180, 157)), (226, 230, 234), 1.5)
    canvas.polygon(at((-5, 62), (52, 62), (60, 78), (72, 78), (72, 128), (-5, 128)), (240, 242, 242))
    canvas.polygon(at((-5, 68), (49, 68), (54, 78), (-5, 78)), (52, 80, 106))
    for x in (8, 26, 44):
        canvas.disc(at((x, 103))[0], 3.6, (52, 80, 106))
    canvas.polygon(at((142, 128), (162, 128), (158, 96), (146, 96)), (214, 128, 40))
    canvas.polygon(at((146, 104), (146, 96), (230, 86), (236, 88), (236, 94), (158, 106)), (236, 148, 52))
    canvas.line(at((170, 104), (176, 94), (192, 101), (198, 92), (212, 98), (216, 90)), (190, 110, 30), 1.2)
    canvas.polygon(at((104, 128), (110, 117), (126, 117), (132, 128)), (70, 84, 100))
    drum = (_DRUM[0], _DRUM[1] - scene.lift)
    canvas.line(
        [(drum[0] + 4, drum[1] - 10), (153, 97 - scene.lift), (_SHEAVE[0], 87 - scene.lift)], _INK, 1.5
    )
    canvas.disc(drum, _DRUM_RADIUS, (38, 50, 66))
    canvas.disc(drum, _DRUM_RADIUS - 2.0, (92, 108, 124))
    # A raised cable turns the drum anticlockwise: it comes in over the top from the right.
    for turn in (0.0, 0.5):
        angle = scene.drum_angle + 2.0 * math.pi * turn
        tip = (drum[0] + 8 * math.sin(-angle), drum[1] - 8 * math.cos(-angle))
        canvas.line([drum, tip], (255, 214, 92) if turn == 0.0 else (60, 74, 90), 2.0)
    canvas.disc(drum, 2.2, (38, 50, 66))


def _draw_sheave(canvas: _Canvas, scene: _Scene) -> None:
    x, y = scene.sheave
    canvas.disc((x - 5.0, y), 6.5, _INK)
    canvas.disc((x - 5.0, y), 3.6, (190, 198, 206))


def _draw_depths(canvas: _Canvas, data: FrameData, scene: _Scene) -> None:
    canvas.dashes((_SHEAVE[0] - 48, scene.still_y), (_SHEAVE[0] + 48, scene.still_y), (186, 208, 222))
    canvas.text((_SHEAVE[0] - 52, scene.still_y), "still position", (170, 194, 210), 9.5, "rm")
    _draw_heave_scale(canvas, data, scene)
    if not scene.depth_shown:
        return
    x = 338.0
    canvas.line([(x, _WATERLINE + 34), (x, _DEEPEST)], _MUTED)
    for share in np.linspace(0.0, 1.0, 6):
        y = scene.depth(share * scene.depth_shown)
        if y > _WATERLINE + 34:
            canvas.line([(x, y), (x + 4, y)], _MUTED)
            canvas.text((x + 7, y), f"{share * scene.depth_shown:g}", _PALE, 9.5, "lm")
    canvas.text((374.0, _DEEPEST + 10), "below boom tip [m]", _MUTED, 9.5, "ra")


def _draw_heave_scale(canvas: _Canvas, data: FrameData, scene: _Scene) -> None:
    """A ruler of ± the largest heave about the payload's still position."""
    x, reach = _SHEAVE[0] + 54.0, _HEAVE_ROOM
    canvas.line([(x, scene.still_y - reach), (x, scene.still_y + reach)], _PALE)
    for sign, label in ((-1, "+"), (1, "-")):
        y = scene.still_y + sign * reach
        canvas.line([(x - 3, y), (x + 3, y)], _PALE)
        canvas.text((x + 5, y), f"{label}{data.largest_heave:g} m", _PALE, 9.0, "lm")


def _draw_cable(canvas: _Canvas, data: FrameData, scene: _Scene) -> None:
    (x, top), (_, bottom) = scene.sheave, scene.payload
    if data.node_tension is None or len(data.node_tension) < 2:
        canvas.line([(x, top), (x, bottom)], _INK, 4.4)
        canvas.line([(x, top), (x, bottom)], _NEUTRAL, 2.4)
        return
    # Fine pieces, so that the colour runs smoothly and slack can be drawn wavy.
    n_pieces = 96
    nodes = np.linspace(0.0, 1.0, len(data.node_tension))
    share = np.linspace(0.0, 1.0, n_pieces + 1)
    tension = np.interp(share, nodes, np.nan_to_num(data.node_tension))
    is_slack = tension <= 0.0
    sway = np.where(is_slack, 3.2 * np.sin(0.5 * np.arange(n_pieces + 1)), 0.0)
    points = [(x + dx, top + (bottom - top) * s) for dx, s in zip(sway, share, strict=True)]
    canvas.line(points, _INK, 4.6)
    scale = data.static_tension or float(np.max(np.abs(tension))) or 1.0
    for i in range(n_pieces):
        color = _SLACK if is_slack[i] or is_slack[i + 1] else tension_color(float(tension[i]) / scale)
        canvas.line(points[i : i + 2], color, 2.6)


def _draw_payload(canvas: _Canvas, data: FrameData, scene: _Scene) -> None:
    x, y = scene.payload
    sling = [(x - 15, y + 12), (x, y), (x + 15, y + 12)]
    canvas.line(sling, _NEUTRAL, 1.4)
    canvas.box((x - 20, y + 12), (x + 20, y + 31), (250, 204, 60), 2.0)
    canvas.box((x - 20, y + 24), (x + 20, y + 31), (206, 152, 30), 2.0)
    for dx in (-13, 0, 13):
        canvas.box((x + dx - 3.5, y + 15), (x + dx + 3.5, y + 21), _INK, 1.0)
    canvas.line([(x - 24, y + 31.5), (x + 24, y + 31.5)], (110, 84, 20), 2.0)


def _draw_tension_scale(canvas: _Canvas, data: FrameData) -> None:
    left, top, bottom = 20.0, 236.0, 380.0
    if data.node_tension is None:
        canvas.text((left, bottom + 10), "linear payload model, no tension", _MUTED, 9.5)
        return
    canvas.text((left, top - 24), "tension [kN]", _PALE, 10.0)
    steps = np.linspace(2.0, 0.0, 72)
    height = (bottom - top) / len(steps)
    for i, ratio in enumerate(steps):
        y = top + i * height
        canvas.box((left, y), (left + 9, y + height), tension_color(float(ratio)))
    for ratio, suffix in ((2.0, ""), (1.5, ""), (1.0, "  static"), (0.5, ""), (0.0, "")):
        y = bottom - (bottom - top) * ratio / 2.0
        canvas.text((left + 14, y), f"{_short(ratio * data.static_tension / 1e3)}{suffix}", _PALE, 9.5, "lm")
    canvas.line([(left + 2, bottom + 16), (left + 4.5, bottom + 13), (left + 7, bottom + 16)], _SLACK, 2.0)
    canvas.line([(left, bottom + 18), (left + 2, bottom + 16)], _SLACK, 2.0)
    canvas.line([(left + 7, bottom + 16), (left + 9, bottom + 14)], _SLACK, 2.0)
    canvas.text((left + 14, bottom + 16), "slack, or pushed", _PALE, 9.5, "lm")


def _draw_caption(canvas: _Canvas, data: FrameData, scene: _Scene) -> None:
    canvas.text((14, 10), data.scenario_name, _INK, 15.0)
    canvas.text((14, 30), f"t = {data.time:.1f} s", (70, 88, 106), 11.5)
    if scene.depth_shown:
        factor = scene.pixels_per_metre * scene.depth_shown / (_DEEPEST - _SHEAVE[1])
        text = f"heave drawn {_two_digits(factor)} times larger than depth"
        canvas.text((_SCENE_WIDTH - 10, 12), text, (70, 88, 106), 10.0, "ra")


# The panel ---------------------------------------------------------------------------------------


def _draw_panel(canvas: _Canvas, data: FrameData) -> None:
    left = float(_SCENE_WIDTH)
    both = [(data.trace_boom_tip, _BOOM_TIP), (data.trace_payload, _PAYLOAD)]
    canvas.text((left + 44, 10), "heave [m]", _PALE, 11.0)
    canvas.text((630, 11), "payload", _PAYLOAD, 10.5, "ra")
    canvas.text((584, 11), "boom tip", _BOOM_TIP, 10.5, "ra")
    _draw_plot(canvas, data, both, top=30.0, bottom=158.0, factor=1.0)
    unit, factor = _unit_for(data.trace_payload, data.payload_heave)
    canvas.text((left + 44, 180), f"payload heave [{unit}]", _PALE, 11.0)
    _draw_plot(canvas, data, both[1:], top=200.0, bottom=312.0, factor=factor)
    canvas.text((630, 328), "time before now [s]", _MUTED, 9.5, "ra")
    _draw_readings(canvas, data)


def _draw_plot(
    canvas: _Canvas,
    data: FrameData,
    traces: list[tuple[np.ndarray, _Color]],
    *,
    top: float,
    bottom: float,
    factor: float,
) -> None:
    """Traces against the time before now, symmetric about zero; values times `factor` are labelled."""
    left, right = _SCENE_WIDTH + 44.0, 630.0
    middle, half = 0.5 * (top + bottom), 0.5 * (bottom - top)
    canvas.box((left, top), (right, bottom), _PLOT, 2.0)
    peaks = [float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0)) for values, _ in traces]
    limit = _rounded_up(factor * max(peaks)) / factor if max(peaks) > _NOTHING else 1.0 / factor
    for share in (-1.0, -0.5, 0.0, 0.5, 1.0):
        y = middle - 0.92 * half * share
        canvas.line([(left, y), (right, y)], _MUTED if share == 0.0 else _GRID, 0.5)
        canvas.text((left - 5, y), f"{share * limit * factor:g}", _MUTED, 9.0, "rm")
    for ago in (60, 40, 20, 0):
        x = right - (right - left) * ago / TRACE_WINDOW
        canvas.line([(x, top), (x, bottom)], _GRID, 0.5)
        canvas.text((x, bottom + 4), f"{-ago}", _MUTED, 9.0, "ma" if ago else "ra")
    shown = data.trace_time >= data.time - TRACE_WINDOW
    across = right - (right - left) * (data.time - data.trace_time[shown]) / TRACE_WINDOW
    for values, color in traces:
        up = 0.92 * half * np.clip(np.nan_to_num(values[shown]) / limit, -1.05, 1.05)
        points = list(zip(across.tolist(), (middle - up).tolist(), strict=True))
        if len(points) > 1:
            canvas.line(points, color, 1.6)
        if points:
            canvas.disc(points[-1], 2.6, color)


def _draw_readings(canvas: _Canvas, data: FrameData) -> None:
    unit, factor = _unit_for(data.trace_payload, data.payload_heave)
    rows = [
        ("payload heave", f"{factor * data.payload_heave:+.2f} {unit}", _PAYLOAD),
        ("boom tip heave", f"{data.boom_tip_heave:+.3f} m", _BOOM_TIP),
        ("winch displacement", f"{data.winch_displacement:+.3f} m", _PALE),
        ("command", f"{data.command:+.3f} m", _PALE),
    ]
    if data.node_tension is not None:
        lowest = float(np.min(data.node_tension))
        is_slack = abs(lowest) < _NO_TENSION
        rows.append(("sheave tension", f"{data.node_tension[0] / 1e3:.1f} kN", _PALE))
        rows.append(("lowest tension", "slack" if is_slack else f"{lowest / 1e3:.1f} kN", _PALE))
        rows.append(("cable outboard", f"{data.length:.2f} m", _PALE))
    for i, (label, reading, color) in enumerate(rows):
        y = 348.0 + 17.5 * i
        canvas.text((_SCENE_WIDTH + 18, y), label, _MUTED, 10.5)
        canvas.text((630, y), reading, color, 10.5, "ra")


# Numbers and words -------------------------------------------------------------------------------


def _rounded_up(value: float, steps: tuple[float, ...] = (1.0, 2.0, 5.0)) -> float:
    """The smallest of `steps` times a power of ten that is at least `value`, which is positive."""
    decade = 10.0 ** math.floor(math.log10(value))
    return next(step * decade for step in (*steps, 10.0) if step * decade >= 0.999999 * value)


def _finite(value: float) -> float:
    return float(value) if math.isfinite(value) else 0.0


def _as_color(values: np.ndarray) -> _Color:
    red, green, blue = (round(float(value)) for value in values)
    return red, green, blue


def _short(value: float) -> str:
    """Three digits, without an exponent."""
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def _two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"


def _unit_for(trace: np.ndarray, now: float) -> tuple[str, float]:
    """Unit in which the largest value is a handy number, and how many of it make a metre."""
    finite = trace[np.isfinite(trace)]
    peak = max(float(np.max(np.abs(finite), initial=0.0)), abs(_finite(now)))
    if peak >= 0.1 or peak <= _NOTHING:
        return "m", 1.0
    return ("cm", 1e2) if peak >= 0.01 else ("mm", 1e3)


def _text_bar(share: float, n_cells: int = 41) -> str:
    """A bar from the middle to `share` of the half width."""
    cells = ["·"] * n_cells
    middle = n_cells // 2
    end = middle + round(min(max(_finite(share), -1.0), 1.0) * middle)
    for i in range(min(middle, end), max(middle, end) + 1):
        cells[i] = "█"
    cells[middle] = "│"
    return "".join(cells)


def _text_trace(trace: np.ndarray, n_cells: int = 60) -> str:
    """The trace as a row of blocks, lowest to highest value, each cell the mean of its samples."""
    finite = trace[np.isfinite(trace)]
    if len(finite) == 0:
        return ""
    cells = np.array([part.mean() for part in np.array_split(finite, min(n_cells, len(finite)))])
    low, span = float(cells.min()), float(np.ptp(cells))
    levels = np.round(7.0 * (cells - low) / span).astype(int) if span > 0.0 else np.full(len(cells), 3)
    return "".join("▁▂▃▄▅▆▇█"[level] for level in levels)
