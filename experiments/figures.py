"""How figures look, and those of a comparison, each the text of an SVG from what its folder holds."""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

Array = np.ndarray

COLOURS = ("#8a8f98", "#cf3b2e", "#eda520", "#0b62a8", "#1ba37c", "#4b1f78", "#5bb8ec", "#e58ab8", "#4f4208")
"""Line colours; the first is kept for no control. They stay apart for those who lack the receptor of red or
of green, and in lightness, for print without colour."""
INK = "#30353d"
"""Colour of what is no controller's: the boom tip, axes' labels, lines of reference."""
DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)), "-", (0, (6, 1.5, 1.2, 1.5)), "-")
"""Line styles that tell controllers apart beside the colour."""
RATIO_TICKS: tuple[float, ...] = (1.0, 2.0, 0.5, 5.0, 0.2, 10.0, 0.1, 20.0, 50.0, 100.0, 1000.0, 0.01, 0.001)
RATIO_TICKS += (0.8, 1.5, 0.7, 0.9, 1.2, 1.1, 0.6, 3.0, 1.05, 0.95, 1.02, 0.98, 1.01, 0.99)
"""Ratios that an axis may bear, the most wanted first [-]."""
SHOWN = 60.0
"""Length of the time series that is drawn [s]."""

STYLE: dict[str, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#7d848f",
    "axes.labelcolor": "#30353d",
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.grid": True,
    "grid.color": "#e3e6ea",
    "grid.linewidth": 0.7,
    "xtick.color": "#4a505a",
    "ytick.color": "#4a505a",
    "legend.frameon": False,
    "lines.linewidth": 1.4,
    "hatch.linewidth": 0.7,
    "svg.hashsalt": "heave",
    "svg.fonttype": "path",
    "path.simplify_threshold": 0.4,
}


def colour_of(labels: Sequence[str]) -> dict[str, str]:
    """A colour per controller: grey for no control, the others in the order they are named."""
    others = [label for label in labels if label != "none"]
    chosen = {label: COLOURS[1 + i % (len(COLOURS) - 1)] for i, label in enumerate(others)}
    return {label: chosen.get(label, COLOURS[0]) for label in labels}


def dashes_of(labels: Sequence[str]) -> dict[str, Any]:
    others = [label for label in labels if label != "none"]
    return {label: DASHES[others.index(label) % len(DASHES)] if label in others else "-" for label in labels}


def _drawn(figure: Any) -> str:
    buffer = io.StringIO()
    figure.savefig(
        buffer,
        format="svg",
        metadata={"Date": None, "Creator": None, "Format": None, "Type": None},
        bbox_inches="tight",
        pad_inches=0.06,
    )
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def _figure(*args: Any, **kwargs: Any) -> tuple[Any, Any]:
    # The object interface without pyplot: no display, no global state, safe in any thread.
    from matplotlib.figure import Figure

    figure = Figure(layout="constrained", figsize=kwargs.pop("figsize"))
    return figure, figure.subplots(*args, **kwargs)


def _on_canvas(draw: Callable[[Any], Any], size: tuple[float, float]) -> tuple[Any, Any]:
    import matplotlib
    from matplotlib.figure import Figure

    context: Any = matplotlib.rc_context
    with context(STYLE):
        figure = Figure(layout="constrained", figsize=size)
        return figure, draw(figure)


def svg(draw: Callable[[Any], None], size: tuple[float, float] = (6.5, 3.8)) -> str:
    """The SVG text of what a function draws on an empty figure of that size [in]."""
    import matplotlib

    figure, _ = _on_canvas(draw, size)
    context: Any = matplotlib.rc_context
    with context(STYLE):
        return _drawn(figure)


def png(
    draw: Callable[[Any], Any], size: tuple[float, float], dpi: int, n_colours: int = 64
) -> tuple[bytes, Any]:
    """A picture as a small PNG file of few colours, and what the drawing function returned."""
    import matplotlib
    from PIL import Image

    figure, returned = _on_canvas(draw, size)
    buffer, small = io.BytesIO(), io.BytesIO()
    context: Any = matplotlib.rc_context
    with context(STYLE):
        figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    image = Image.open(buffer).convert("RGB").quantize(n_colours, method=Image.Quantize.MEDIANCUT)
    image.save(small, format="png", optimize=True)
    return small.getvalue(), returned


def _styled(draw: Any) -> Any:
    from functools import wraps

    @wraps(draw)
    def styled(*args: Any, **kwargs: Any) -> str:
        import matplotlib

        context: Any = matplotlib.rc_context
        with context(STYLE):
            return str(draw(*args, **kwargs))

    return styled


def _decades(axis: Any, small: float, large: float) -> None:
    """A scale that is linear up to the decade of `small` and logarithmic to that of `large`, both signs."""
    first, last = math.ceil(math.log10(small)), math.ceil(math.log10(large))
    ticks = [10.0**power for power in range(first, last + 1, max(1, (last - first) // 2))]
    axis.set_yscale("symlog", linthresh=10.0**first, linscale=1.0)
    axis.set_yticks([-tick for tick in reversed(ticks)] + [0.0] + ticks)
    axis.set_yticklabels([f"{tick:g}" for tick in axis.get_yticks()])
    axis.minorticks_off()


def metres(size: float) -> tuple[float, str]:
    """Factor and unit in which lengths of about this size read well."""
    if size < 2e-3:
        return 1e6, "µm"
    return (1e3, "mm") if size < 0.2 else (1.0, "m")


def time_series(time: Array, channels: dict[str, dict[str, Array]], *, start: float, delay: float) -> str:
    """One sea in every controller's hands: heave, command, drum and tension; arguments as `draw_series`."""
    end = min(start + SHOWN, float(time[-1]))
    panels = series_panels(channels)
    return svg(
        lambda figure: draw_series(figure, time, channels, start=start, end=end, delay=delay),
        series_size(panels),
    )


def series_panels(channels: dict[str, dict[str, Array]]) -> list[str]:
    """What is drawn of the series of some controllers, from the top."""
    first = next(iter(channels.values()))
    panels = ["motion", "payload", "command"] + (["rate"] if "winch_rate" in first else [])
    return panels + (["tension"] if any("sheave_tension" in series for series in channels.values()) else [])


def series_size(panels: Sequence[str]) -> tuple[float, float]:
    """Size of a figure with so many panels [in]."""
    return 8.4, 1.75 * len(panels) + 0.5


def draw_series(
    figure: Any,
    time: Array,
    channels: dict[str, dict[str, Array]],
    *,
    start: float,
    end: float,
    delay: float,
    rate_limit: float = math.inf,
    names: Sequence[str] = (),
) -> None:
    """Draws one sea in every controller's hands.

    Args:
        figure: What to draw on.
        time: Control instants [s], (n_steps + 1,).
        channels: By controller and channel, the series of one sea [SI].
        start: Where the drawn part begins [s].
        end: Where it ends [s].
        delay: Command delay of the scenario [s].
        rate_limit: Largest speed of the drum [m/s], drawn where it lies near.
        names: Everybody, in the order that gives them colours; none: the controllers.
    """
    labels = list(channels)
    colours, dashes = colour_of(names or labels), dashes_of(names or labels)
    shown = (time >= start - 1e-9) & (time <= end + 1e-9)
    acting = [label for label in labels if label != "none"] or labels
    panels = series_panels(channels)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)
    place = dict(zip(panels, axes[:, 0], strict=True))

    def drawn(panel: str, channel: str, factor: float, among: Sequence[str]) -> None:
        for label in among:
            if channel in channels[label]:
                series = factor * channels[label][channel][shown]
                style = {"color": colours[label], "ls": dashes[label]}
                place[panel].plot(time[shown], series, lw=1.2, label=label, **style)

    axis = place["motion"]
    boom_tip = channels[labels[0]]["boom_tip_heave"][shown]
    axis.plot(time[shown], boom_tip, color=INK, lw=1.0, label="boom tip")
    title = "What the sea does: boom tip"
    if "none" in labels:
        free = channels["none"]["payload_heave"][shown]
        axis.plot(time[shown], free, color=COLOURS[0], lw=2.0, label="payload, none")
        title += ", and the payload without control"
    axis.set_ylabel("heave [m]")
    axis.set_title(title)
    axis.legend(loc="lower right", bbox_to_anchor=(1.0, 0.97), ncols=2, fontsize=8)
    shares = [float(np.std(channels[label]["payload_heave"][shown])) for label in acting]
    scale, unit = metres(max(shares))
    title = "Payload heave under control"
    quiet = [share for share in shares if share > 0.0]
    drawn("payload", "payload_heave", scale, acting)
    if quiet and max(quiet) > 30.0 * min(quiet):
        _decades(place["payload"], 3.0 * scale * min(quiet), 4.0 * scale * max(quiet))
        title += ", logarithmic beyond the inner ticks"
    place["payload"].set_ylabel(f"payload [{unit}]")
    place["payload"].set_title(title)
    axis = place["command"]
    steps = shown[:-1]
    for label in acting:
        style = {"color": colours[label], "ls": dashes[label], "lw": 1.0, "label": label}
        axis.step(time[:-1][steps], channels[label]["command"][steps], where="post", **style)
    axis.set_ylabel("command [m]")
    axis.set_title(
        f"Commanded winch displacement (acts {delay:g} s later)" if delay else "Commanded winch displacement"
    )
    if "rate" in place:
        drawn("rate", "winch_rate", 1.0, acting)
        axis = place["rate"]
        fastest = max(float(np.abs(channels[label]["winch_rate"][shown]).max()) for label in acting)
        title = "Drum rate, positive hauls in"
        if rate_limit < 3.0 * fastest:
            for limit in (-rate_limit, rate_limit):
                axis.axhline(limit, color=INK, lw=0.9, ls=(0, (2, 2)))
            title += f"; dotted the limit, {rate_limit:g} m/s"
        axis.set_ylabel("drum [m/s]")
        axis.set_title(title)
    if "tension" in place:
        drawn("tension", "sheave_tension", 1e-3, labels)
        place["tension"].set_ylabel("tension [kN]")
        place["tension"].set_title("Tension at the sheave")
    axes[-1, 0].set_xlabel("time [s]")
    axes[-1, 0].set_xlim(start, end)
    figure.align_ylabels(list(axes[:, 0]))
    handles, said = place["payload"].get_legend_handles_labels()
    if "none" in labels and "none" not in said:
        from matplotlib.lines import Line2D

        handles, said = [Line2D([], [], color=COLOURS[0]), *handles], ["none", *said]
    figure.legend(handles, said, loc="outside lower center", ncols=min(5, len(said)))


@_styled
def spectra(omega: Array, boom_tip: Array | None, payload: dict[str, Array]) -> str:
    """Spectral densities of payload heave on the boom tip's, log-scaled.

    Args:
        omega: Angular frequency [rad/s].
        boom_tip: Density of the boom-tip heave [m² s/rad], or None.
        payload: Density of the payload heave by controller [m² s/rad].
    """
    labels = list(payload)
    colours, dashes = colour_of(labels), dashes_of(labels)
    figure, axis = _figure(figsize=(5.6, 3.9))
    band = (omega > 0.0) & (omega <= 4.0)
    peaks = []
    curves = [("boom tip", boom_tip, INK, (0, (2, 2)))]
    curves += [(label, payload[label], colours[label], dashes[label]) for label in labels]
    for label, density, colour, dash in curves:
        if density is None or not np.isfinite(density).all() or not np.any(density[band] > 0.0):
            continue
        axis.plot(omega[band], np.maximum(density[band], 1e-300), color=colour, ls=dash, label=label)
        peaks.append(float(density[band].max()))
    axis.set_yscale("log")
    if peaks:
        axis.set_ylim(1e-5 * min(peaks), 4.0 * max(peaks))
    axis.set_xlim(0.0, 4.0)
    axis.set_xlabel("angular frequency [rad/s]")
    axis.set_ylabel("spectral density [m² s/rad]")
    axis.set_title("Spectra of payload heave, mean over all seas")
    if peaks:
        axis.legend(fontsize=8, loc="upper right")
    return _drawn(figure)


@_styled
def motion_against_energy(heave_std: dict[str, Array], energy: dict[str, Array]) -> str:
    """Payload standard deviation against control energy, one dot per sea and the mean of each controller.

    Args:
        heave_std: Standard deviation of payload heave by controller [m], (n_seas,).
        energy: Mean square command by controller [m²], (n_seas,).
    """
    labels = list(heave_std)
    colours = colour_of(labels)
    figure, axis = _figure(figsize=(5.6, 3.9))
    for label in labels:
        x, y = energy[label], heave_std[label]
        usable = np.isfinite(x) & np.isfinite(y) & (y > 0.0)
        if not usable.any():
            continue
        if not np.any(x[usable] > 0.0):
            axis.axhline(
                y[usable].mean(), color=colours[label], lw=1.6, ls=(0, (4, 2)), label=f"{label} (energy 0)"
            )
            continue
        usable &= x > 0.0
        axis.scatter(x[usable], y[usable], s=18, color=colours[label], alpha=0.5, lw=0)
        axis.scatter(
            x[usable].mean(),
            y[usable].mean(),
            s=70,
            color=colours[label],
            edgecolor="white",
            lw=1.2,
            label=label,
            zorder=3,
        )
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_xlabel("control energy, mean u0² [m²]")
    axis.set_ylabel("std of payload heave [m]")
    axis.set_title("Motion against energy: small dots are seas")
    if axis.get_legend_handles_labels()[0]:
        axis.legend(fontsize=8)
    return _drawn(figure)


@_styled
def distribution(heave_std: dict[str, Array]) -> str:
    """Payload standard deviation in each sea, by controller, with median, 95 % and maximum.

    Args:
        heave_std: Standard deviation of payload heave by controller [m], (n_seas,).
    """
    labels = list(heave_std)
    colours = colour_of(labels)
    figure, axis = _figure(figsize=(8.4, 0.55 * len(labels) + 1.2))
    for place, label in enumerate(labels):
        values = heave_std[label]
        values = np.sort(values[np.isfinite(values) & (values > 0.0)])
        if len(values) == 0:
            continue
        # Neighbours in size are set apart up and down, so that equal seas do not hide each other.
        offset = 0.26 * (((np.arange(len(values)) * 0.618034) % 1.0) - 0.5)
        axis.scatter(values, place + offset, s=16, color=colours[label], alpha=0.45, lw=0)
        for share, height in ((0.5, 0.30), (0.95, 0.20)):
            at = float(np.quantile(values, share))
            axis.plot(
                [at, at],
                [place - height, place + height],
                color=colours[label],
                lw=2.2 if share == 0.5 else 1.2,
            )
        axis.scatter(values[-1], place, marker=">", s=34, color=colours[label], zorder=3)
    axis.set_yticks(range(len(labels)), labels)
    axis.set_ylim(len(labels) - 0.5, -0.5)
    axis.set_xscale("log")
    axis.grid(axis="y", visible=False)
    axis.set_xlabel("std of payload heave in a sea [m]; long bar median, short bar 95 %, arrow maximum")
    axis.set_title("Every sea counts")
    return _drawn(figure)


def performance_profiles(
    thresholds: Array, shares: dict[str, Array], reference: str, names: Sequence[str]
) -> str:
    """Share of seas (and trainings) in which the cost is at most so many times the reference's; arguments as
    `draw_profiles`."""
    return svg(lambda figure: draw_profiles(figure, thresholds, shares, reference, names), (8.4, 3.9))


def draw_profiles(
    figure: Any,
    thresholds: Array,
    shares: dict[str, Array],
    reference: str,
    names: Sequence[str],
    bands: dict[str, tuple[Array, Array]] | None = None,
) -> None:
    """Draws performance profiles.

    Args:
        figure: What to draw on.
        thresholds: Ratios [-], (n_thresholds,), increasing.
        shares: By contestant, (n_thresholds,) [-].
        reference: Whose cost the ratios are over.
        names: Everybody, in the order that gives them colours.
        bands: By contestant the ends of an interval, (n_thresholds,) each [-].
    """
    colours, dashes = colour_of(names), dashes_of(names)
    axis = figure.subplots()
    # In the order of the legend: who is further left and higher stands above.
    for label in sorted(shares, key=lambda name: -float(np.mean(shares[name]))):
        if label == reference:
            continue  # a step at one
        if bands is not None:
            ends = [100.0 * end for end in bands[label]]
            axis.fill_between(thresholds, *ends, color=colours[label], alpha=0.13, lw=0)
        axis.plot(thresholds, 100.0 * shares[label], color=colours[label], ls=dashes[label], label=label)
    axis.axvline(1.0, color=INK, lw=1.0, ls=(0, (2, 2)), label=f"{reference} (ratio 1)")
    axis.set_xscale("log")
    axis.set_xlim(thresholds[0], thresholds[-1])
    axis.set_ylim(0.0, 101.0)
    low, high = float(thresholds[0]), float(thresholds[-1])
    ticks: list[float] = []
    for tick in RATIO_TICKS:
        apart = min((abs(math.log(tick / other)) for other in ticks), default=math.inf)
        if low <= tick <= high and apart > math.log(high / low) / 12.0:
            ticks.append(tick)
    axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.minorticks_off()
    axis.set_xlabel(f"cost J over that of {reference} in the same sea, at most")
    axis.set_ylabel("share of seas [%]")
    axis.set_title("Performance profiles: further left and higher is better")
    axis.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))


MAP_COLUMNS = 3
"""Maps side by side."""
NUMBERED = 12
"""Periods up to which the classes of a map bear their numbers."""


def _map_grid(heights: Sequence[float], periods: Sequence[float], n_maps: int) -> tuple[Any, list[Any]]:
    """A figure with a map for each controller: classes in equal boxes, heights upwards."""
    columns = 2 if n_maps == 4 else min(n_maps, MAP_COLUMNS)
    rows = math.ceil(n_maps / columns)
    width = 8.4 if columns > 1 else 5.2
    tall = min(max(0.27 * len(heights), 1.6), 4.2) + 0.75
    figure, axes = _figure(
        rows, columns, figsize=(width, tall * rows), sharex=True, sharey=True, squeeze=False
    )
    places = list(axes.flat)
    for axis in places:
        axis.grid(False)
        for name, values in (("x", periods), ("y", heights)):
            step = math.ceil(len(values) / 14)
            ticks = range(0, len(values), step)
            getattr(axis, f"set_{name}ticks")(ticks, [f"{values[i]:g}" for i in ticks], fontsize=8)
        axis.set_xlim(-0.5, len(periods) - 0.5)
        axis.set_ylim(-0.5, len(heights) - 0.5)
        axis.tick_params(length=0)
    for axis in places[n_maps:]:
        axis.set_axis_off()
    for axis in axes[:, 0]:
        axis.set_ylabel("Hs [m]")
    for i in range(max(0, n_maps - columns), n_maps):
        places[i].set_xlabel("Tp [s]")
        places[i].tick_params(labelbottom=True)
    return figure, places


def _hatched(axis: Any, where: Array, colour: str) -> None:
    from matplotlib.patches import Rectangle

    for i, j in zip(*np.nonzero(where), strict=True):
        box = Rectangle((j - 0.5, i - 0.5), 1.0, 1.0, fill=False, hatch="///", lw=0.0, ec=colour)
        axis.add_patch(box)


def _written(axis: Any, at: tuple[int, int], text: str, *, dark: bool = False) -> None:
    """Writes on a class, legible on its colour and on a hatch."""
    from matplotlib.patheffects import withStroke

    ink, halo = ("#ffffff", "#1d3557") if dark else ("#20242b", "#ffffff")
    around = [withStroke(linewidth=1.6, foreground=halo, alpha=0.6)]
    axis.text(at[1], at[0], text, ha="center", va="center", fontsize=7, color=ink, path_effects=around)


def _brief(value: float) -> str:
    """A number in at most four characters or so."""
    if value == 0.0:
        return "0"
    if 0.0 < value < 0.0095:
        return "<.01"
    decimals = 0 if abs(value) >= 9.95 else (1 if abs(value) >= 0.995 else 2)
    return f"{value:.{decimals}f}".replace("-", "−")


@_styled
def operable_maps(
    heights: Sequence[float], periods: Sequence[float], share: Array, states: dict[str, Array]
) -> str:
    """In which classes of a scatter diagram work may go on, a map for each controller.

    Args:
        heights: Significant wave heights [m], increasing.
        periods: Peak periods [s], increasing.
        share: Occurrence of the classes [%], (n_heights, n_periods), NaN where there is none.
        states: By controller 1 where operable, 0 where not, and a half more where more seas could turn it.
    """
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    figure, places = _map_grid(heights, periods, len(states))
    no, yes = "#e9a3ab", "#8fd0a9"
    for axis, (label, state) in zip(places, states.items(), strict=False):
        operable = np.where(np.isnan(state), np.nan, np.floor(state))
        axis.imshow(operable, origin="lower", aspect="auto", cmap=ListedColormap([no, yes]), vmin=0, vmax=1)
        _hatched(axis, np.isin(state, (0.5, 1.5)), "#ffffff")
        axis.set_title(label)
        if len(periods) <= NUMBERED:
            for i, j in zip(*np.nonzero(~np.isnan(state)), strict=True):
                _written(axis, (i, j), _brief(share[i, j]))
    handles = [Patch(fc=yes, label="operable"), Patch(fc=no, label="not operable")]
    if any(np.isin(state, (0.5, 1.5)).any() for state in states.values()):
        handles.append(Patch(fc="#c8ccd2", ec="#ffffff", hatch="////", label="undecided"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return _drawn(figure)


@_styled
def sea_maps(
    heights: Sequence[float],
    periods: Sequence[float],
    grids: dict[str, Array],
    title: str,
    unit: str,
    broken: dict[str, Array],
    failed: dict[str, Array],
) -> str:
    """A quantity over the classes of a scatter diagram, a map for each controller on one scale of colours.

    Args:
        heights: Significant wave heights [m], increasing.
        periods: Peak periods [s], increasing.
        grids: The quantity by controller, (n_heights, n_periods); NaN where there is no class.
        title: What it is.
        unit: Its unit; metres are shown as mm where that reads better.
        broken: By controller, where it breaks a limit.
        failed: By controller, where it has no number since seas failed.
    """
    from matplotlib.colors import LogNorm, Normalize

    figure, places = _map_grid(heights, periods, len(grids))
    finite = np.concatenate([grid[np.isfinite(grid)] for grid in grids.values()])
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    # What a decaying lag leaves of zero is zero.
    grids = {label: np.where(np.abs(grid) < 1e-9 * abs(high), 0.0, grid) for label, grid in grids.items()}
    low, factor = 0.0 if abs(low) < 1e-9 * abs(high) else low, 1.0
    if unit == "m":
        factor, unit = metres(high if low > 0.02 else 0.1)
    low, high = factor * low, factor * high
    wide = low > 0.0 and high > 30.0 * low
    low = low if wide or low < 0.0 or high < 3.0 * low else 0.0
    norm: Any = LogNorm(low, high) if wide else Normalize(low, high if high > low else low + 1.0)
    image = None
    for axis, (label, grid) in zip(places, grids.items(), strict=False):
        shown = np.where(np.isfinite(grid), factor * grid, np.nan)
        image = axis.imshow(shown, origin="lower", aspect="auto", cmap="YlGnBu", norm=norm)
        axis.set_title(label)
        _hatched(axis, np.nan_to_num(broken[label]) > 0.0, "#c2334a")
        if len(periods) > NUMBERED:
            continue
        for i, j in zip(*np.nonzero(~np.isnan(grid)), strict=True):
            text = "failed" if failed[label][i, j] else _brief(shown[i, j])
            dark = np.isfinite(shown[i, j]) and norm(shown[i, j]) > 0.6
            _written(axis, (i, j), text, dark=bool(dark))
    if image is not None:
        bar = figure.colorbar(image, ax=places, pad=0.015, aspect=28)
        bar.set_label("-" if unit == "-" else f"[{unit}]")
        bar.outline.set_visible(False)
    figure.suptitle(title, x=0.02, ha="left", fontsize=10.5, fontweight="bold")
    return _drawn(figure)


# Names beside what they name ---------------------------------------------------------------------


def plain_ticks(axis: Any, which: str, most: int = 8) -> None:
    """Ticks of a logarithmic axis at 1, 2 and 5 times powers of ten, or at powers alone, in plain numbers."""
    low, high = getattr(axis, f"get_{which}lim")()
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for steps in ((1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0), (1.0, 2.0, 5.0), (1.0, 3.0), (1.0,)):
        ticks = [step * 10.0**power for power in powers for step in steps]
        ticks = [tick for tick in ticks if low <= tick <= high]
        if len(ticks) <= most:
            break
    else:
        ticks = ticks[:: math.ceil(len(ticks) / most)]
    getattr(axis, f"set_{which}ticks")(ticks, [f"{tick:g}" for tick in ticks])
    axis.minorticks_off()


REACHES = (5.0, 9.0, 14.0, 20.0, 28.0, 38.0, 50.0, 65.0)
"""How far from its point a name may stand [pt], the nearest first."""
CURVE_STEP = 3.0
"""Distance of the points that stand for a curve where names are kept clear of it [pt]."""


def name_points(
    axis: Any, points: Sequence[tuple[str, float, float, str]], curves: Sequence[Array] = ()
) -> list[Any]:
    """Writes a name beside each point, clear of the other names, the points and the curves as far as it goes.

    The axis must have its limits and everything that its layout depends on.

    Args:
        axis: Where.
        points: Name, x, y and colour of each.
        curves: What else to keep clear of, each (n, 2) in the axis's own units.

    Returns:
        The texts, in the order of the points.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.patheffects import withStroke

    figure = axis.figure
    FigureCanvasAgg(figure)
    figure.draw_without_rendering()
    scale = 72.0 / figure.dpi
    frame = axis.get_window_extent()
    low, high = scale * np.array(frame.min), scale * np.array(frame.max)

    def placed(values: Array) -> Array:
        return scale * np.asarray(axis.transData.transform(np.asarray(values, dtype=float)))

    spots = [placed(np.array([[x, y]]))[0] for _, x, y, _ in points]
    taken = [np.array(spots).reshape(-1, 2), *(_dense(placed(curve)) for curve in curves if len(curve))]
    obstacles = np.concatenate(taken)
    boxes: list[tuple[Array, Array]] = []
    texts = []
    for (name, x, y, colour), spot in zip(points, spots, strict=True):
        around = [withStroke(linewidth=2.2, foreground="#ffffff")]
        text = axis.annotate(name, (x, y), color=colour, fontsize=8.5, path_effects=around, zorder=6)
        text.set_in_layout(False)
        extent = text.get_window_extent()
        half = 0.5 * scale * np.array([extent.width, extent.height]) + 1.0
        offset = _clear(spot, half, obstacles, boxes, low, high)
        boxes.append((spot + offset - half, spot + offset + half))
        text.remove()
        far = np.abs(offset)[0] > half[0] + 12.0 or np.abs(offset)[1] > half[1] + 12.0
        text = axis.annotate(
            name,
            (x, y),
            xytext=tuple(offset),
            textcoords="offset points",
            ha="center",
            va="center",
            color=colour,
            fontsize=8.5,
            path_effects=around,
            zorder=6,
            arrowprops={"arrowstyle": "-", "color": colour, "lw": 0.6, "shrinkB": 4} if far else None,
        )
        text.set_in_layout(False)
        texts.append(text)
    return texts


def _clear(
    spot: Array, half: Array, obstacles: Array, boxes: Sequence[tuple[Array, Array]], low: Array, high: Array
) -> Array:
    """Where the middle of a name stands best relative to its point [pt]."""
    best, least = np.zeros(2), math.inf
    for reach in REACHES:
        for angle in np.arange(0.0, 360.0, 22.5):
            direction = np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle))])
            offset = direction * (half + reach)
            below, above = spot + offset - half, spot + offset + half
            outside = float(np.maximum(low - below, 0.0).sum() + np.maximum(above - high, 0.0).sum())
            hidden = float(np.all((obstacles > below) & (obstacles < above), axis=1).sum())
            shared = sum(
                float(np.prod(np.maximum(np.minimum(above, to) - np.maximum(below, at), 0.0)))
                for at, to in boxes
            )
            cost = 20.0 * outside + 25.0 * hidden + 5.0 * shared + reach
            if cost < least - 1e-9:
                best, least = offset, cost
    return best


def _dense(curve: Array) -> Array:
    """Points along a polyline, none further from the next than `CURVE_STEP`."""
    curve = curve[np.isfinite(curve).all(axis=1)]
    if len(curve) < 2:
        return curve
    pieces = []
    for first, last in itertools.pairwise(curve):
        count = max(1, min(400, math.ceil(float(np.hypot(*(last - first))) / CURVE_STEP)))
        pieces.append(first + (last - first) * np.arange(count)[:, None] / count)
    return np.concatenate([*pieces, curve[-1:]])


def name_ends(axis: Any, ends: Sequence[tuple[str, float, str]], *, gap: float = 11.0) -> list[Any]:
    """Writes a name at the right of the axis for each line that ends at a height, set apart where they crowd.

    Args:
        axis: Where; its limits must stand.
        ends: Name, height and colour of each.
        gap: Least distance of two names [pt].
    """
    figure = axis.figure
    figure.draw_without_rendering()
    scale = 72.0 / figure.dpi
    frame = axis.get_window_extent()
    bottom, top = scale * frame.ymin, scale * frame.ymax
    order = sorted(range(len(ends)), key=lambda i: ends[i][1])
    wanted = [
        float(np.clip(scale * axis.transData.transform((axis.get_xlim()[1], ends[i][1]))[1], bottom, top))
        for i in order
    ]
    texts: list[Any] = [None] * len(ends)
    for i, height, given in zip(order, apart(wanted, gap, bottom, top), wanted, strict=True):
        name, _, colour = ends[i]
        texts[i] = axis.annotate(
            name,
            (1.0, (given - bottom) / (top - bottom)),
            xycoords="axes fraction",
            xytext=(12.0, height - given),
            textcoords="offset points",
            va="center",
            color=colour,
            fontsize=8.5,
            annotation_clip=False,
            arrowprops={
                "arrowstyle": "-",
                "color": colour,
                "lw": 0.6,
                "shrinkA": 1,
                "shrinkB": 0,
                "relpos": (0.0, 0.5),
            },
        )
    return texts


def apart(wanted: Sequence[float], gap: float, low: float, high: float) -> list[float]:
    """Heights near those that are wanted, no two nearer than a gap, within the ends if they can be.

    Args:
        wanted: Heights, increasing.
        gap: Least distance.
        low: Lower end.
        high: Upper end.
    """
    # Neighbours that touch are merged into a group about the mean of what they want.
    groups: list[list[float]] = []
    middles: list[float] = []
    for height in wanted:
        groups.append([height])
        middles.append(height)
        while len(groups) > 1 and middles[-1] - middles[-2] < 0.5 * gap * (len(groups[-1]) + len(groups[-2])):
            last = groups.pop()
            groups[-1] += last
            middles.pop()
            middles[-1] = sum(groups[-1]) / len(groups[-1])
    found = []
    for group, middle in zip(groups, middles, strict=True):
        found += [middle + gap * (i - 0.5 * (len(group) - 1)) for i in range(len(group))]
    for i in range(len(found)):  # pushed up from the bottom, then down from the top
        found[i] = max(found[i], low + gap * i)
    for i in reversed(range(len(found))):
        found[i] = min(found[i], high - gap * (len(found) - 1 - i))
    return found
