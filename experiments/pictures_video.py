"""A storm as a moving picture: the same sea without compensation and with it, side by side, with traces.

Everything is drawn from what the environments were stepped through, at their own pace or faster; the same
seed gives the same file. GIF is written by Pillow, MP4 and WebM by the encoder of `imageio-ffmpeg`.
"""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from experiments import figures, runs
from experiments.pictures import Progress, write_about
from heave_env.controller import Controller, shown_to
from heave_env.env import HeaveEnv
from heave_env.render import FrameData, draw_scene
from heave_env.scenarios import Scenario

Array = np.ndarray

FORMATS = ("gif", "mp4", "webm")
"""Endings of the files that can be written."""
CODECS = {"mp4": "libx264", "webm": "libvpx-vp9"}
LENGTH = 30.0
"""Length of a video unless asked otherwise [s]."""
MOST_FRAMES = 12.5
"""Frames shown in a second at most [1/s]."""
N_COLOURS = 240
"""Colours of a GIF [-]."""
TRACE_HEIGHT = 236
"""Height of the traces below the scenes [px]."""
GAP = 6
"""White between the scenes [px]."""
CHANNELS = ("boom_tip_heave", "payload_heave", "winch_displacement", "winch_rate", "command")
"""Channels in the table beside a video, and `sheave_tension` with a cable."""
_UNITS = {"winch_rate": "m/s", "sheave_tension": "N"}


@dataclass(frozen=True)
class Take:
    """One controller in the sea: what the pictures and the table need of each control instant."""

    label: str
    channels: dict[str, Array]
    """Series from the start of the episode, (n_steps + 1,) [SI]."""
    tensions: list[Array | None]
    """Tension along the cable at each instant that is filmed, (n_elements,) [N]."""
    lengths: Array
    """Cable outboard at each control instant [m]."""


def take(scenario: Scenario, label: str, controller: Controller, seed: int, first: int, last: int) -> Take:
    """Lets a controller act in a sea, and keeps what is filmed.

    Args:
        scenario: The operation.
        label: The controller's name.
        controller: What acts.
        seed: Seed of the sea.
        first: Control step from which tensions are kept.
        last: Control step after which the film ends.

    Raises:
        ValueError: If the episode ends before the film does.
    """
    env = HeaveEnv(shown_to(controller, scenario), render_mode="rgb_array")
    names = (*CHANNELS, *(() if scenario.is_linear else ("sheave_tension",)))
    series: dict[str, list[float]] = {name: [] for name in (*names, "length")}
    tensions: list[Array | None] = []
    observation, _ = env.reset(seed=seed)
    memory: Any = None
    for step in range(last + 1):
        for name, values in series.items():
            values.append(float(env.plant.channel(name)[0]))
        if step >= first:
            tensions.append(env.plant.element_tensions(0))
        if step == last:
            break
        action, memory = controller.predict(
            observation[None], state=memory, episode_start=np.array([step == 0]), deterministic=True
        )
        observation, _, terminated, truncated, _ = env.step(np.asarray(action)[0])
        if (terminated or truncated) and step + 1 < last:
            raise ValueError(
                f"the episode of {label} ends at {(step + 1) * scenario.control_dt:g} s, before the video "
                "does; give an earlier --start or a smaller --length"
            )
    env.close()
    lengths = np.array(series.pop("length"))
    return Take(label, {name: np.array(values) for name, values in series.items()}, tensions, lengths)


@dataclass(frozen=True, kw_only=True)
class Film:
    """What is filmed: the same sea for each take."""

    scenario: Scenario
    seed: int
    takes: Sequence[Take]
    first: int
    """Control step of the first frame."""
    last: int
    """Control step of the last frame at most."""
    stride: int
    """Control steps from frame to frame [-]."""
    speed: float = 1.0
    """How many times faster than it happened it is shown [-]."""

    @property
    def steps(self) -> range:
        """Control steps that have a frame."""
        return range(self.first, self.last + 1, self.stride)

    @property
    def largest(self) -> float:
        """Heave that both scenes have room for [m]."""
        shown = slice(max(0, self.first - 600), self.last + 1)
        values = [
            np.abs(item.channels[name][shown]).max()
            for item in self.takes
            for name in ("boom_tip_heave", "payload_heave")
        ]
        return float(max(values))

    def frame_data(self, item: Take, step: int) -> FrameData:
        """What the scene of a take shows at a step."""
        dt, channels = self.scenario.control_dt, item.channels
        past = slice(max(0, step - round(60.0 / dt)), step + 1)
        return FrameData(
            scenario_name=TITLES.get(item.label, item.label),
            time=step * dt,
            boom_tip_heave=channels["boom_tip_heave"][step],
            winch_displacement=channels["winch_displacement"][step],
            payload_heave=channels["payload_heave"][step],
            command=channels["command"][step],
            length=float(item.lengths[step]),
            node_tension=item.tensions[step - self.first],
            static_tension=self.scenario.static_tension,
            trace_time=dt * np.arange(past.start, past.stop),
            trace_boom_tip=channels["boom_tip_heave"][past],
            trace_payload=channels["payload_heave"][past],
            motion_range=self.largest,
        )

    def frames(self, width: int | None = None) -> Iterator[Array]:
        """Every picture in turn, brought to a width [px]."""
        for step in self.steps:
            yield _resized(self.frame(step), width)

    def frame(self, step: int) -> Array:
        """The picture at a step, uint8, (height, width, 3)."""
        scenes = []
        for item in self.takes:
            scene = draw_scene(self.frame_data(item, step))
            scenes += [scene, np.full((scene.shape[0], GAP, 3), 255, dtype=np.uint8)]
        above = np.hstack(scenes[:-1])
        return np.vstack([above, self._traces(above.shape[1], step)])

    def _traces(self, width: int, step: int) -> Array:
        return _Traces(self, width).drawn(step)


TITLES = {"none": "no compensation"}
"""What a scene is called where the controller's name says little."""


def filmed(
    scenario: Scenario,
    controllers: dict[str, Controller],
    seed: int,
    *,
    start: float = 100.0,
    length: float = LENGTH,
    speed: float = 1.0,
    progress: Progress | None = None,
) -> Film:
    """Lets each controller act in a sea from its beginning, to be filmed from `start` on.

    Args:
        scenario: The operation, long enough.
        controllers: What acts, by name.
        seed: Seed of the sea.
        start: Where the film begins [s].
        length: How long it is [s].
        speed: How many times faster than it happened it is shown [-].
        progress: Called with scenario, label, steps done since the last call and steps in all.

    Raises:
        ValueError: If nobody acts, the speed is impossible, or an episode ends before the film does.
    """
    if not controllers:
        raise ValueError("no controller was named; name two, as none,lqg")
    if not 0.1 <= speed <= 20.0:
        raise ValueError(f"speed must be from 0.1 to 20, got {speed:g}")
    dt = scenario.control_dt
    first, last = round(start / dt), round((start + length) / dt)
    if last > scenario.n_steps:
        raise ValueError(
            f"the video ends at {start + length:g} s, the episode of {scenario.name!r} at "
            f"{scenario.duration:g} s; give an earlier --start or a smaller --length"
        )
    takes = []
    for label, controller in controllers.items():
        takes.append(take(scenario, label, controller, seed, first, last))
        if progress is not None:
            progress(scenario.name, label, 1, 1)
    stride = max(1, math.ceil(speed / (MOST_FRAMES * dt) - 1e-9))
    return Film(scenario=scenario, seed=seed, takes=takes, first=first, last=last, stride=stride, speed=speed)


# The traces below the scenes ---------------------------------------------------------------------


class _Traces:
    """Two plots on a light ground: all heaves in metres, and the payload's under the last controller."""

    LEFT, RIGHT = 58, 132
    INK, SOFT, GRID = (48, 53, 61), (110, 117, 128), (227, 230, 234)

    def __init__(self, film: Film, width: int) -> None:
        self.film, self.width = film, width
        labels = [item.label for item in film.takes]
        self.colours: dict[str, Any] = {
            label: tuple(int(colour[i : i + 2], 16) for i in (1, 3, 5))
            for label, colour in figures.colour_of(labels).items()
        }

    def drawn(self, step: int) -> Array:
        """The strip at a step, uint8, (TRACE_HEIGHT, width, 3)."""
        from PIL import Image, ImageDraw

        film, scale = self.film, 2
        image = Image.new("RGB", (scale * self.width, scale * TRACE_HEIGHT), (255, 255, 255))
        self.pen, self.scale = ImageDraw.Draw(image), scale
        last = film.takes[-1]
        upper = [("boom tip", self.INK, film.takes[0].channels["boom_tip_heave"])]
        upper += [
            (TITLES.get(item.label, item.label), self.colours[item.label], item.channels["payload_heave"])
            for item in film.takes
        ]
        factor, unit = figures.metres(0.5 * self._peak([last.channels["payload_heave"]]))
        self._plot((32, 114), "heave: boom tip and payload [m]", upper, 1.0, step)
        title = f"payload heave with {TITLES.get(last.label, last.label)} [{unit}]"
        own = [(last.label, self.colours[last.label], last.channels["payload_heave"])]
        self._plot((146, 212), title, own, factor, step)
        self._text((self.width - self.RIGHT + 25, 221), "time [s]", self.SOFT, "lm")
        self._text((self.width - 8, 14), f"{film.scenario.name}, sea {film.seed}", self.SOFT, "rm", 11.0)
        return np.array(image.reduce(scale), dtype=np.uint8)

    def _peak(self, series: Sequence[Array]) -> float:
        shown = slice(self.film.first, self.film.last + 1)
        return max(float(np.abs(values[shown]).max()) for values in series)

    def _plot(
        self,
        heights: tuple[int, int],
        title: str,
        traces: Sequence[tuple[Any, ...]],
        factor: float,
        step: int,
    ) -> None:
        film, dt = self.film, self.film.scenario.control_dt
        top, bottom = heights
        left, right = float(self.LEFT), float(self.width - self.RIGHT)
        limit = _nice(factor * self._peak([values for _, _, values in traces]))
        middle, half = 0.5 * (top + bottom), 0.5 * (bottom - top)

        def across(index: Array | float) -> Any:
            return left + (right - left) * (index - film.first) / max(1, film.last - film.first)

        begin, end = film.first * dt, film.last * dt
        every = next(one for one in (1, 2, 5, 10, 20, 50, 100, 500) if (end - begin) / one <= 8)
        for share in (-1.0, 0.0, 1.0):
            y = middle - share * half
            self._line([(left, y), (right, y)], self.GRID if share else self.SOFT, 0.6)
            self._text((left - 8, y), f"{share * limit:g}", self.SOFT, "rm")
        for second in range(math.ceil(begin / every) * every, math.floor(end) + 1, every):
            x = across(second / dt)
            self._line([(x, top), (x, bottom)], self.GRID, 0.6)
            if bottom > 200:
                self._text((x, bottom + 9), f"{second:g}", self.SOFT, "mm")
        self._text((left, top - 10), title, self.INK, "lm", 11.0)
        shown = np.arange(film.first, step + 1)
        names = []
        for name, colour, values in traces:
            y = middle - half * np.clip(factor * values[shown] / limit, -1.05, 1.05)
            points = list(zip(across(shown).tolist(), y.tolist(), strict=True))
            if len(points) > 1:
                self._line(points, colour, 1.6 if name != "boom tip" else 1.1)
            self._disc(points[-1], 2.6, colour)
            names.append((name, colour))
        spread = figures.apart([middle] * len(names), 14.0, top, bottom)
        for (name, colour), y in zip(names, spread, strict=True):
            self._line([(right + 8, y), (right + 20, y)], colour, 2.0)
            self._text((right + 25, y), name, colour, "lm")

    def _line(self, points: Sequence[tuple[float, float]], colour: Any, width: float) -> None:
        scaled = [(self.scale * x, self.scale * y) for x, y in points]
        self.pen.line(scaled, fill=colour, width=max(1, round(self.scale * width)), joint="curve")

    def _disc(self, at: tuple[float, float], radius: float, colour: Any) -> None:
        x, y = (self.scale * value for value in at)
        reach = self.scale * radius
        self.pen.ellipse((x - reach, y - reach, x + reach, y + reach), fill=colour)

    def _text(self, at: tuple[float, float], text: str, colour: Any, anchor: str, size: float = 10.5) -> None:
        place = (self.scale * at[0], self.scale * at[1])
        self.pen.text(place, text, fill=colour, font=_font(self.scale * size), anchor=anchor)


@lru_cache(maxsize=8)
def _font(size: float) -> Any:
    from PIL import ImageFont

    return ImageFont.load_default(size)


def _nice(value: float) -> float:
    """1, 2 or 5 times a power of ten, at least the value."""
    decade = 10.0 ** math.floor(math.log10(max(value, 1e-9)))
    return next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= 0.999 * value)


# The files ---------------------------------------------------------------------------------------


def check_formats(formats: Sequence[str]) -> tuple[str, ...]:
    """The formats asked for, each known and its encoder there.

    Raises:
        ValueError: If one is unknown, or needs a package that is not installed.
    """
    wanted = tuple(dict.fromkeys(name.strip().lower() for name in formats if name.strip()))
    for name in wanted:
        if name not in FORMATS:
            raise ValueError(f"a video is {', '.join(FORMATS)}, got {name!r}")
    if not wanted:
        raise ValueError(f"no format was named; choose from {', '.join(FORMATS)}")
    if set(wanted) & set(CODECS):
        _encoder()
    return wanted


def _encoder() -> Any:
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise ValueError(
            "MP4 and WebM want the encoder of imageio-ffmpeg: install it with pip install "
            "'heave-env[video]', or write a gif"
        ) from error
    return imageio_ffmpeg


def usual_formats() -> tuple[str, ...]:
    """GIF, and MP4 where its encoder is installed."""
    try:
        _encoder()
    except ValueError:
        return ("gif",)
    return ("gif", "mp4")


def write_video(
    film: Film,
    folder: Path,
    *,
    formats: Sequence[str] = ("gif",),
    width: int | None = None,
    arguments: list[str] | None = None,
) -> list[Path]:
    """Writes a film, the numbers of every frame as CSV, and where it comes from.

    Args:
        film: What was filmed.
        folder: Where.
        formats: Endings among `FORMATS`.
        width: Width of the picture [px]; None: as drawn.
        arguments: Command line of the provenance; None: the process's own.

    Raises:
        ValueError: If a format is unknown or lacks its encoder, or an argument is impossible.
    """
    wanted = check_formats(formats)
    if width is not None and not 160 <= width <= 4000:
        raise ValueError(f"width must be from 160 px to 4000 px, got {width}")
    dt = film.scenario.control_dt
    pause = film.stride * dt / film.speed  # between frames [s]
    name = f"video-{film.scenario.name}-{film.seed}"
    written = []
    for ending in wanted:
        path = folder / f"{name}.{ending}"
        if ending == "gif":
            runs.write_bytes(path, gif(film, pause, width))
        else:
            _encode(path, film.frames(width), 1.0 / pause, ending)
        written.append(path)
    names = list(film.takes[0].channels)
    rows = [
        (item.label, round(step * dt, 9), *(item.channels[channel][step] for channel in names))
        for item in film.takes
        for step in film.steps
    ]
    columns = ("controller", "time [s]", *(f"{channel} [{_UNITS.get(channel, 'm')}]" for channel in names))
    written.append(runs.write_text(folder / f"{name}.csv", runs.table_text(columns, rows)))
    told = " and ".join(TITLES.get(item.label, item.label) for item in film.takes)
    caption = (
        f"{film.scenario.name}, sea {film.seed}, {film.first * dt:g} s to {film.last * dt:g} s: {told}, "
        f"side by side{'' if film.speed == 1.0 else f', {film.speed:g} times as fast as it happened'}."
    )
    about = {"scenario": film.scenario.name, "seed": film.seed, "files": [path.name for path in written]}
    return [*written, write_about(name, "video", caption, about, folder, arguments)]


def _resized(frame: Array, width: int | None) -> Array:
    if width is None or width == frame.shape[1]:
        return frame
    from PIL import Image

    height = round(frame.shape[0] * width / frame.shape[1])
    return np.array(Image.fromarray(frame).resize((width, height), Image.Resampling.LANCZOS))


def gif(film: Film, pause: float, width: int | None = None) -> bytes:
    """An endless GIF of few colours, the same ones in every frame.

    Args:
        film: What was filmed.
        pause: Time from frame to frame [s], which the format rounds to hundredths.
        width: Width of the picture [px]; None: as drawn.
    """
    from PIL import Image

    # One palette, of frames from the whole film: pixels that stay as they are need not be sent again.
    steps = film.steps
    some = [steps[i] for i in np.unique(np.linspace(0, len(steps) - 1, 6).astype(int))]
    # Small things want their colours too: half of the palette is of how often a colour is, half of which are.
    joined = np.concatenate([_resized(film.frame(step), width).reshape(-1, 3) for step in some])
    kinds = np.unique(joined // 12, axis=0) * 12 + 6
    halves = [Image.fromarray(colours.astype(np.uint8)[None]) for colours in (joined, kinds)]
    quantized = [half.quantize(N_COLOURS // 2, method=Image.Quantize.MEDIANCUT) for half in halves]
    colours = [channel for half in quantized for channel in (half.getpalette() or [])[: 3 * N_COLOURS // 2]]
    palette = Image.new("P", (1, 1))
    palette.putpalette(colours)
    images = [
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in film.frames(width)
    ]
    buffer = io.BytesIO()
    hundredths = max(2, round(100.0 * pause))
    images[0].save(
        buffer,
        format="gif",
        save_all=True,
        append_images=images[1:],
        duration=10 * hundredths,
        loop=0,
        disposal=1,
        optimize=True,  # what stays as it is is left transparent
    )
    return buffer.getvalue()


def _encode(path: Path, frames: Iterator[Array], rate: float, ending: str) -> None:
    """Writes a file by the encoder, beside its place, and renames it into it."""
    encoder = _encoder()
    draft = path.with_name(f".{path.stem}.draft.{ending}")
    first = next(frames)
    height, width = (side - side % 2 for side in first.shape[:2])  # the codecs want even sides
    # One thread, no dates, no names: the same frames make the same file.
    plain = ["-threads", "1", "-fflags", "+bitexact", "-flags:v", "+bitexact", "-map_metadata", "-1"]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        writer = encoder.write_frames(
            str(draft),
            (width, height),
            fps=rate,
            codec=CODECS[ending],
            quality=None,
            macro_block_size=1,
            ffmpeg_log_level="error",
            output_params=["-crf", "24", *(["-b:v", "0"] if ending == "webm" else []), *plain],
        )
        writer.send(None)
        for frame in itertools.chain([first], frames):
            writer.send(np.ascontiguousarray(frame[:height, :width]))
        writer.close()
        draft.replace(path)
    except OSError as error:
        raise ValueError(f"cannot write {str(path)!r}: {error}") from error
    finally:
        draft.unlink(missing_ok=True)
