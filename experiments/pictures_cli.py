"""`heave pictures KIND`: what the command line asks of each kind of picture."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import parsers, runs
from experiments.rollout import FIRST_TEST_SEED
from heave_env.scenarios import Scenario

if TYPE_CHECKING:  # the command starts quicker without
    from experiments.pictures import Picture, Progress, Scored

OUT = "runs/pictures"
"""Folder of pictures that belong to no run's folder."""
FIRST_SEEDS = {"test": FIRST_TEST_SEED, "validation": 10_000_000, "training": 9_500_000}
"""First seed of the seas that have a name; those of training are apart from those of tuning."""
EXAMPLES = (
    "heave pictures fronts limits_linear --controllers none,pid,lqg,mpc,agent:runs/ppo --out runs/fronts",
    "heave pictures storm runs/mine --seed roughest",
    "heave pictures learning ppo=runs/ppo_* --rivals lqg,mpc",
    "heave pictures profiles runs/league",
    "heave pictures video sea_state_5 --controllers none,lqg",
)


def add_kinds(parser: Any) -> None:
    """Adds the kinds of picture to the verb's parser."""
    kinds = parser.add_subparsers(metavar="KIND", required=True, dest="kind", parser_class=type(parser))

    def kind(name: str, summary: str, *examples: str) -> Any:
        epilog = "example:\n" + "\n".join(f"  {example}" for example in examples)
        return kinds.add_parser(name, help=summary, description=summary + ".", epilog=epilog)

    fronts = kind(
        "fronts",
        "what is left of the motion against what it takes, with the fronts of designs over their weights",
        EXAMPLES[0],
        "heave pictures fronts runs/league --scenario limits_linear --designs lqg,mpc",
    )
    _add_source(fronts, "none,lqg", "all without variants")
    fronts.add_argument(
        "--designs", metavar="A,B,...", help="whose weights are swept (lqg, with winch limits mpc too)"
    )
    fronts.add_argument(
        "--weights",
        type=parsers.count,
        default=None,
        metavar="N",
        help="weights along each ray, then refined (9)",
    )
    fronts.add_argument(
        "--seeds", type=parsers.count, metavar="N", help="the first N seas (16; a folder's, all)"
    )
    fronts.add_argument(
        "--workers",
        type=parsers.count,
        metavar="N",
        help="processes that run side by side (one for each processor)",
    )
    fronts.add_argument(
        "--first-sea",
        metavar="SEED",
        help=f"{', '.join(FIRST_SEEDS)} or the seed of the first sea (test; a folder's own)",
    )
    fronts.add_argument(
        "--duration", type=parsers.seconds, metavar="S", help="length of an episode [s] (400)"
    )
    _add_out(fronts)

    storm = kind(
        "storm",
        "one sea in every controller's hands: boom tip, payload, command, drum, tension",
        EXAMPLES[1],
        "heave pictures storm limits_cable --controllers none,lqg,mpc --seed 20000003",
    )
    _add_source(storm, "none,lqg")
    _add_sea(storm)
    storm.add_argument("--length", type=parsers.seconds, default=60.0, metavar="S", help="how long [s] (60)")
    _add_out(storm)

    learning = kind(
        "learning",
        "validation over steps and wall time: the middle and the range of several training seeds",
        EXAMPLES[2],
        "heave pictures learning runs/contest/cells/* --quantity payload_heave_std",
    )
    learning.add_argument("runs", nargs="+", metavar="RUN", help="folders, NAME=RUN1+RUN2 or NAME=PATTERN")
    learning.add_argument(
        "--rivals", metavar="A,B,...", help="controllers to run in the same validation seas, as lines"
    )
    learning.add_argument(
        "--quantity",
        default="cost_mean",
        metavar="NAME",
        help="cost_mean, cost_median, cost_max, payload_heave_std or command_std (cost_mean)",
    )
    learning.add_argument("--out", default=OUT, metavar="DIR", help=f"folder for the files ({OUT})")

    profiles = kind(
        "profiles",
        "performance profiles: in which share of all seas a ratio of costs is not exceeded",
        EXAMPLES[3],
        "heave pictures profiles runs/league --scenario limits_linear,unknown_linear --reference mpc",
    )
    profiles.add_argument("source", metavar="DIR", help="folder of a comparison or league")
    profiles.add_argument(
        "--scenario", metavar="A,B,...", help="scenarios, as NAME or NAME@VARIANT (all without variants)"
    )
    profiles.add_argument("--variants", action="store_true", help="all variants too")
    profiles.add_argument("--reference", metavar="NAME", help="whose cost ratios are over (the run's)")
    _add_out(profiles)

    video = kind(
        "video",
        "a sea without compensation and with it, side by side, as GIF (and MP4 where the encoder is there)",
        EXAMPLES[4],
        "heave pictures video limits_cable --controllers none,mpc --seed roughest --format gif,mp4 --speed 2",
    )
    _add_source(video, "none,lqg")
    _add_sea(video)
    video.add_argument("--length", type=parsers.seconds, default=30.0, metavar="S", help="how long [s] (30)")
    video.add_argument("--speed", type=parsers.positive, default=1.0, metavar="X", help="times as fast (1)")
    video.add_argument("--width", type=parsers.count, metavar="PX", help="width of the picture [px] (770)")
    video.add_argument(
        "--format", metavar="A,B,...", help="gif, mp4, webm (gif, and mp4 where its encoder is installed)"
    )
    _add_out(video)


def _add_source(parser: Any, controllers: str, which: str = "the first") -> None:
    parser.add_argument(
        "source", metavar="SOURCE", help="folder of a comparison or league, scenario's name or YAML file"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY.PATH=VALUE",
        dest="settings",
        help="change a value of the scenario, as winch.command_delay=0.4; may be repeated",
    )
    parser.add_argument(
        "--scenario",
        metavar="NAME",
        help=f"of a folder: which scenario, as NAME or NAME@VARIANT ({which})",
    )
    parser.add_argument(
        "--controllers",
        metavar="A,B,...",
        help="designs, agent:RUN, file:PATH.py, NAME=agent:RUN1+agent:RUN2; of a folder: its entries "
        f"({controllers}; a folder's all)",
    )
    parser.add_argument(
        "--allow-other-scenario",
        action="store_true",
        help="let an agent act in a scenario it was not trained for, if it sees the same",
    )


def _add_sea(parser: Any) -> None:
    parser.add_argument(
        "--seed",
        default=None,
        metavar="SEED",
        help=f"seed of the sea, or roughest: of the first 16, or of a folder's ({FIRST_TEST_SEED})",
    )
    parser.add_argument(
        "--start", type=float, metavar="S", help="where it begins [s] (about the largest wave)"
    )


def _add_out(parser: Any) -> None:
    parser.add_argument(
        "--out", metavar="DIR", help=f"folder for the files (pictures/ in a run's folder, or else {OUT})"
    )


# What is done ------------------------------------------------------------------------------------


def draw(
    options: argparse.Namespace, *, scenario: Scenario | None = None, progress: Progress | None = None
) -> list[Path]:
    """Draws what was asked for; returns the files, the pictures first.

    Args:
        options: What the parser of `add_kinds` made.
        scenario: The scenario that the source names, if it is no folder.
        progress: Called with scenario, label, steps done since the last call and steps in all.

    Raises:
        ValueError: If anything asked for is impossible.
    """
    made = {
        "fronts": _fronts,
        "storm": _storm,
        "learning": _learning,
        "profiles": _profiles,
        "video": _video,
    }[options.kind](options, scenario, progress)
    _redraw(options)
    return made


def _is_run(source: str) -> bool:
    """Whether there is a folder of that name that holds a run."""
    return (Path(source) / runs.RUN_FILE).is_file()


def names_scenario(options: argparse.Namespace) -> bool:
    """Whether the source is a scenario, and no folder of a run."""
    return hasattr(options, "source") and options.kind != "profiles" and not _is_run(options.source)


def _folder(options: argparse.Namespace) -> Path:
    from experiments.pictures import FOLDER

    given = options.out
    if given is None:
        own = hasattr(options, "source") and _is_run(options.source)
        given = Path(options.source) / FOLDER if own else OUT
    return runs.check_folder(given, "pictures")


def _redraw(options: argparse.Namespace) -> None:
    """The page of a league shows the pictures in its folder: it is drawn anew when they change."""
    from experiments.league_page import SUMMARY_FILE, write_page

    source = Path(getattr(options, "source", ""))
    if options.kind != "video" and options.out is None and (source / SUMMARY_FILE).is_file():
        write_page(source)


def _written(pictures: Sequence[Picture], folder: Path, arguments: list[str]) -> list[Path]:
    from experiments.pictures import write

    return [path for picture in pictures for path in write(picture, folder, arguments)]


def _split(text: str | None) -> list[str] | None:
    return None if text is None else [item.strip() for item in text.split(",") if item.strip()]


def _first_seed(text: str | None) -> int:
    text = "test" if text is None else text
    if text in FIRST_SEEDS:
        return FIRST_SEEDS[text]
    if not text.isdigit():
        raise ValueError(f"--first-sea takes {', '.join(FIRST_SEEDS)} or the seed of a sea, got {text!r}")
    return int(text)


def _scored(options: argparse.Namespace) -> list[Scored]:
    """The scenarios that are asked for of a folder.

    Raises:
        ValueError: If an option is given that a folder does not take.
    """
    from experiments.pictures import chosen, read_scored

    if options.settings:
        raise ValueError("--set changes a scenario that is named, not one that a folder holds")
    for name in ("first_sea", "duration"):
        if getattr(options, name, None) is not None:
            told = f"--{name.replace('_', '-')}"
            raise ValueError(
                f"{told} is of a scenario that is named; a folder's seas are those it was run in"
            )
    return chosen(read_scored(options.source), options.scenario)


def _only_some(scored: Scored, wanted: Sequence[str] | None) -> Scored:
    """The entries that are asked for.

    Raises:
        ValueError: If one did not act.
    """
    import dataclasses

    if wanted is None:
        return scored
    for name in wanted:
        if name not in scored.values:
            raise ValueError(f"{name!r} did not act there; choose from {', '.join(scored.values)}")
    return dataclasses.replace(
        scored,
        specs={name: scored.specs[name] for name in wanted},
        values={name: scored.values[name] for name in wanted},
        ends={name: scored.ends[name] for name in wanted},
    )


def _named(scenario: Scenario, options: argparse.Namespace) -> Any:
    """The contestants of a scenario that is named, those designed for it by default.

    Raises:
        ValueError: If one is unknown, or an option is given that only a folder takes.
    """
    from experiments.league import contestants

    if options.scenario is not None:
        raise ValueError(
            f"--scenario chooses from what a folder holds, and {options.source!r} is none; name the scenario "
            "alone"
        )
    return contestants((options.controllers or "none,lqg").split(","))


def _fronts(options: argparse.Namespace, scenario: Scenario | None, progress: Progress | None) -> list[Path]:
    from experiments import pictures_fronts as fronts
    from experiments.pictures import score
    from experiments.processes import worker_count

    folder = _folder(options)
    first, n_weights = _first_seed(options.first_sea), options.weights or fronts.N_WEIGHTS
    workers = worker_count(options.workers)
    designs = _split(options.designs)
    for design in designs or ():
        fronts.swept_weights(design)
    if scenario is None:
        parts = [_only_some(item, _split(options.controllers)) for item in _scored(options)]
        parts = [item if options.seeds is None else item.first_seas(options.seeds) for item in parts]
    else:
        teams = _named(scenario, options)
        parts = [
            score(
                scenario,
                teams,
                range(first, first + (options.seeds or 16)),
                folder,
                duration=options.duration,
                allow_other_scenario=options.allow_other_scenario,
                workers=workers,
                progress=progress,
            )
        ]
    made = []
    for item in parts:
        swept = {
            design: fronts.sweep(
                design,
                item.scenario,
                item.basis,
                range(item.first_seed, item.first_seed + item.n_seas),
                folder,
                n_weights=n_weights,
                warm_up=item.warm_up,
                workers=workers,
                progress=progress,
            )
            for design in designs or fronts.default_designs(item.scenario)
        }
        made.append(fronts.fronts_picture(item, swept))
    return _written(made, folder, options.arguments)


def _one_scored(options: argparse.Namespace, scenario: Scenario | None, length: float) -> Scored:
    """The scenario of a single sea: the first one of a folder, or the one that is named."""
    from experiments.compare import protocol_duration
    from experiments.leaderboard import NOMINAL
    from experiments.metrics import window
    from experiments.pictures import Scored
    from experiments.rollout import with_duration

    if scenario is None:
        return _only_some(_scored(options)[0], _split(options.controllers))
    teams = _named(scenario, options)
    wanted = protocol_duration(scenario)
    if options.start is not None:  # a later part of a longer episode
        end = scenario.control_dt * round((options.start + length) / scenario.control_dt)
        wanted = min(scenario.duration, max(wanted, end))
    met = with_duration(scenario, wanted)
    return Scored(
        scenario=met,
        basis=scenario.design_basis,
        variant=scenario.name.partition("@")[2] or NOMINAL,
        names=tuple(team.name for team in teams),
        reference=teams[0].name,
        first_seed=FIRST_TEST_SEED,
        warm_up=window(met.duration, met.control_dt).warm_up,
        specs={team.name: team.specs for team in teams},
        values={},
        ends={},
    )


def _sea(
    options: argparse.Namespace, scored: Scored, source: Path | None, folder: Path, progress: Progress | None
) -> int:
    """Seed of the sea that is asked for."""
    from experiments.pictures_storm import ROUGHEST, roughest, roughest_of

    if options.seed is None:
        return scored.first_seed
    if options.seed == ROUGHEST:
        return roughest_of(scored, 16, folder, progress) if source is None else roughest(scored)
    if not options.seed.isdigit():
        raise ValueError(f"--seed takes the seed of a sea or {ROUGHEST}, got {options.seed!r}")
    return int(options.seed)


def _storm(options: argparse.Namespace, scenario: Scenario | None, progress: Progress | None) -> list[Path]:
    from experiments import pictures_storm as storm

    source, folder = (Path(options.source) if scenario is None else None), _folder(options)
    scored = _one_scored(options, scenario, options.length)
    seed = _sea(options, scored, source, folder, progress)
    series = storm.series_of(scored, None, seed, source=source, folder=folder, progress=progress)
    picture = storm.storm_picture(scored, series, seed, start=options.start, length=options.length)
    return _written([picture], folder, options.arguments)


def _learning(
    options: argparse.Namespace, scenario: Scenario | None, progress: Progress | None
) -> list[Path]:
    from experiments import pictures_learning as learning

    folder = _folder(options)
    if options.quantity not in learning.QUANTITIES:
        raise ValueError(
            f"there is no quantity {options.quantity!r}; choose from {', '.join(learning.QUANTITIES)}"
        )
    trainings = learning.trainings_of(options.runs)
    first = next(iter(trainings.values()))[0]
    rivals = _split(options.rivals)
    found = None if rivals is None else learning.rivals_of(rivals, first, folder)
    return _written(
        [learning.learning_picture(trainings, options.quantity, found)], folder, options.arguments
    )


def _profiles(
    options: argparse.Namespace, scenario: Scenario | None, progress: Progress | None
) -> list[Path]:
    from experiments.pictures import chosen, read_scored
    from experiments.pictures_profiles import profiles_picture

    if not _is_run(options.source):
        raise ValueError(
            f"{options.source!r} holds no comparison and no league; name a folder that heave compare or "
            "heave league wrote"
        )
    scored = chosen(read_scored(options.source), options.scenario, variants=options.variants)
    picture = profiles_picture(scored, options.reference)
    return _written([picture], _folder(options), options.arguments)


def _video(options: argparse.Namespace, scenario: Scenario | None, progress: Progress | None) -> list[Path]:
    from experiments import pictures_video as video
    from experiments.league import Contestant
    from experiments.pictures import entries_of

    formats = (
        video.usual_formats() if options.format is None else video.check_formats(options.format.split(","))
    )
    source, folder = (Path(options.source) if scenario is None else None), _folder(options)
    if source is not None and options.controllers is None:
        options.controllers = ",".join(_pair(_scored(options)[0]))
    scored = _one_scored(options, scenario, options.length)
    seed = _sea(options, scored, source, folder, progress)
    teams = [Contestant(name, specs[:1]) for name, specs in scored.specs.items()]
    by_team = entries_of(scored.basis, teams, allow_other_scenario=options.allow_other_scenario)
    film = video.filmed(
        scored.scenario,
        {name: entries[0].controller for name, entries in by_team.items()},
        seed,
        start=scored.warm_up if options.start is None else options.start,
        length=options.length,
        speed=options.speed,
        progress=progress,
    )
    return video.write_video(film, folder, formats=formats, width=options.width, arguments=options.arguments)


def _pair(scored: Scored) -> list[str]:
    """Whom a video of a folder shows: no control if it took part, and the reference of the run."""
    others = [name for name in scored.values if name != "none"]
    shown = scored.reference if scored.reference != "none" or not others else others[0]
    return list(dict.fromkeys(name for name in ("none", shown) if name in scored.values))
