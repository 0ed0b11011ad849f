"""The `heave` command: a verb for each thing the laboratory does.

A wrong input ends with one sentence on stderr and exit code 2, an interruption with exit code 130; in
both cases the files that were there before are still there.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from experiments import parsers
from experiments.pictures_cli import EXAMPLES, add_kinds
from experiments.rollout import FIRST_TEST_SEED
from heave_env import __version__, scenarios
from heave_env.cable.convergence import ConvergenceError
from heave_env.scenarios import Scenario

FAILED = 1
"""Exit code of a validation that failed."""
BAD_INPUT = 2
"""Exit code of a wrong input."""
INTERRUPTED = 130
"""Exit code of an interruption by the keyboard, 128 + SIGINT."""

ALGORITHMS = ("ppo", "recurrent_ppo", "sac", "td3", "tqc")


class Parser(argparse.ArgumentParser):
    """Argument parser whose complaint is one sentence."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        kwargs.setdefault("formatter_class", argparse.RawDescriptionHelpFormatter)
        kwargs.setdefault("allow_abbrev", False)
        super().__init__(*args, **kwargs)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Lets names stand behind options too, which argparse refuses where any number of them may stand."""
        found, left = super().parse_known_args(args, namespace)
        lists = [action.dest for action in self._get_positional_actions() if action.nargs == "*"]
        if lists and not any(word.startswith("-") for word in left):
            setattr(found, lists[-1], [*(getattr(found, lists[-1], None) or []), *left])
            left = []
        return found, left

    def error(self, message: str) -> NoReturn:
        """Prints the sentence and leaves with exit code 2."""
        self.exit(BAD_INPUT, f"heave: {message}; see {self.prog} --help\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line and returns its exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = parser().parse_args(given)
    options.arguments = given
    try:
        options.run(options)
        sys.stdout.flush()
    except (ValueError, ConvergenceError) as error:
        print(f"heave: {' '.join(str(error).split())}", file=sys.stderr)
        return BAD_INPUT
    except ModuleNotFoundError as error:
        print(f"heave: this needs the package {error.name!r}; install it with pip", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        resumable = (_train, _sweep, _demo, _compare, _league, _validate, _reproduce, _operability, _zoo)
        resumes = options.run in (*resumable, _pictures)
        hint = "the same command goes on from there" if resumes else "nothing half-written was left behind"
        print(f"heave: interrupted; {hint}", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output has left, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return int(options.exit_code)


# What can be asked for ---------------------------------------------------------------------------


def parser() -> Parser:
    """The command line's grammar."""
    top = Parser(
        prog="heave",
        description="A laboratory for active heave compensation: simulate, train, compare, report.",
        epilog="start with:\n  heave demo\n  heave scenarios list\n"
        "  heave compare sea_state_5 --out runs/first",
    )

    top.add_argument("--version", action="version", version=f"heave {__version__}")
    verbs = top.add_subparsers(metavar="VERB", required=True, parser_class=Parser)

    def verb(name: str, run: Callable[[argparse.Namespace], None], summary: str, *examples: str) -> Parser:
        epilog = "example:\n" + "\n".join(f"  {example}" for example in examples)
        made = verbs.add_parser(name, help=summary, description=summary + ".", epilog=epilog)
        made.set_defaults(run=run, exit_code=0)
        return made

    demo = verb(
        "demo",
        _demo,
        "train an agent on a cable scenario, compare it with the thesis's controllers, write the report",
        "heave demo --seeds 16 --out runs/demo",
    )
    demo.add_argument("--seeds", type=int, default=None, metavar="N", help="unseen seas to compare in (16)")
    demo.add_argument("--steps", type=parsers.count, metavar="N", help="training steps (the preset's)")
    demo.add_argument("--seed", type=parsers.seed, default=0, metavar="N", help="seed of the training (0)")
    demo.add_argument(
        "--duration", type=parsers.seconds, metavar="S", help="length of an episode compared [s] (400)"
    )
    demo.add_argument("--out", default="runs/demo", metavar="DIR", help="folder for the results (runs/demo)")

    listing = verb(
        "scenarios",
        _scenarios,
        "list the named scenarios and their variants, show one as YAML, or write their pages",
        "heave scenarios list",
        "heave scenarios show sea_state_5 > mine.yaml",
        "heave scenarios show sea_state_5@rougher",
        "heave scenarios page landing --out docs/scenarios",
    )
    listing.add_argument("action", choices=("list", "show", "page"), help="what to do")
    listing.add_argument(
        "scenario", nargs="?", metavar="SCENARIO", help="name or YAML file, for show; name, for page (all)"
    )
    listing.add_argument("--tag", metavar="TAG", help="list only the scenarios with this tag")
    listing.add_argument(
        "--seeds", type=int, default=8, metavar="N", help="of a page: the first N test seas (8)"
    )
    listing.add_argument(
        "--controllers", metavar="A,B,...", help="of a page: designs (none, forecast, lqg, mpc and others)"
    )
    listing.add_argument(
        "--duration", type=parsers.seconds, metavar="S", help="of a page: length of an episode [s]"
    )
    listing.add_argument(
        "--out", default="docs/scenarios", metavar="DIR", help="folder of the pages (docs/scenarios)"
    )
    _add_set(listing)

    simulate = verb(
        "simulate",
        _simulate,
        "run one sea and write its channels as CSV",
        "heave simulate sea_state_5 --controller lqg --duration 60 --out run.csv",
        "heave simulate thesis_cable --motion boom_tip.csv --set length=500 --out run.csv",
    )
    _add_scenario(simulate)
    _add_set(simulate)
    simulate.add_argument("--motion", metavar="FILE.csv", help="boom-tip motion that replaces sea and vessel")
    simulate.add_argument(
        "--controller", default="none", metavar="NAME", help="a design, agent:RUN or zoo:NAME (none)"
    )
    simulate.add_argument(
        "--seed",
        type=parsers.seed,
        default=FIRST_TEST_SEED,
        metavar="N",
        help=f"seed of the sea ({FIRST_TEST_SEED}, the first test sea)",
    )
    simulate.add_argument("--duration", type=parsers.seconds, metavar="S", help="length of the run [s]")
    _add_other(simulate)
    simulate.add_argument("--out", required=True, metavar="FILE.csv", help="file to write")

    train = verb(
        "train",
        _train,
        "train an agent; the same folder resumes an interrupted training",
        "heave train sea_state_5 --algorithm ppo --seed 3 --out runs/ppo_3",
    )
    _add_scenario(train)
    _add_set(train)
    train.add_argument("--algorithm", choices=ALGORITHMS, default="ppo", help="learning algorithm (ppo)")
    train.add_argument(
        "--preset",
        metavar="KIND|FILE|zoo:NAME",
        help="kind of agent (residual, estimate, rate beside a designed controller, taught by one), or a "
        "YAML file of settings; learning from the sensors if not given",
    )
    train.add_argument("--seed", type=parsers.seed, default=0, metavar="N", help="seed of the training (0)")
    train.add_argument("--steps", type=parsers.count, metavar="N", help="environment steps (the preset's)")
    train.add_argument("--out", metavar="DIR", help="run folder (runs/SCENARIO-ALGORITHM-SEED)")

    sweep = verb(
        "sweep",
        _sweep,
        "train over scenarios, algorithms, kinds and seeds, or search for settings; the same command resumes",
        "heave sweep seeds.yaml --out runs/seeds --workers 2",
        "heave sweep seeds.yaml --out /shared/seeds --address 10.0.0.1:6379",
    )
    sweep.add_argument("file", metavar="FILE.yaml", help="what to train (docs/sweeps.md)")
    sweep.add_argument(
        "--out", metavar="DIR", help="folder for the runs and the table (runs/ and the file's name)"
    )
    sweep.add_argument(
        "--address",
        metavar="ADDRESS",
        help="Ray cluster to run on; DIR must lie on a file system that all its nodes see (this machine)",
    )
    sweep.add_argument(
        "--workers",
        type=parsers.count,
        metavar="N",
        help="trainings at a time, one processor each (all); 1 needs no Ray",
    )

    compare = verb(
        "compare",
        _compare,
        "run controllers in the same unseen seas; write tables and a report",
        "heave compare sea_state_5 --controllers none,lqg,agent:runs/demo/ppo --seeds 64 --out runs/mine",
    )
    compare.add_argument("scenario", nargs="+", metavar="SCENARIO", help="names or YAML files")
    _add_set(compare)
    compare.add_argument(
        "--controllers",
        default="none,lqr,delay_lqr,lqg",
        metavar="A,B,...",
        help="designs, agent:RUN, zoo:NAME and file:PATH.py, separated by commas (none,lqr,delay_lqr,lqg)",
    )
    compare.add_argument(
        "--seeds", type=int, default=16, metavar="N", help="compare in the first N test seas (16)"
    )
    compare.add_argument(
        "--duration", type=parsers.seconds, metavar="S", help="length of an episode [s] (400)"
    )
    compare.add_argument("--warm-up", type=float, metavar="S", help="time left out at its start [s] (100)")
    compare.add_argument("--dtype", choices=("float64", "float32"), default="float64", help="plant precision")
    compare.add_argument("--reference", metavar="NAME", help="controller that differences are from (lqg)")
    compare.add_argument(
        "--clairvoyant",
        action="store_true",
        help="also the least cost of who knows each sea beforehand (linear payload; seconds for each sea)",
    )
    compare.add_argument(
        "--oracle",
        action="store_true",
        help="also the cost of who knows what each episode draws, and every cost over it (uncertainty)",
    )
    _add_other(compare)
    compare.add_argument("--out", required=True, metavar="DIR", help="folder for the results")

    table = verb(
        "league",
        _league,
        "run everybody in the same unseen seas of scenarios and their variants; write the leaderboard",
        "heave league limits_linear --controllers lqg,mpc,ppo=agent:runs/ppo_* --out runs/league",
        "heave league sea_state_5 --controllers all,file:mine.py --variants rougher,later --out runs/league",
    )
    table.add_argument("scenario", nargs="+", metavar="SCENARIO", help="names or YAML files")
    _add_set(table)
    table.add_argument(
        "--controllers",
        default="all",
        metavar="A,B,...",
        help="designs (all: every one), agent:RUN, zoo:NAME, file:PATH.py, NAME=agent:RUN1+agent:RUN2 (all)",
    )
    table.add_argument(
        "--zoo", action="store_true", help="also the agents of the zoo, each in its scenario and its variants"
    )
    table.add_argument(
        "--variants", default="all", metavar="A,B,...", help="variants of each scenario; nominal: none (all)"
    )
    table.add_argument("--seeds", type=int, default=256, metavar="N", help="the first N test seas (256)")
    table.add_argument("--duration", type=parsers.seconds, metavar="S", help="length of an episode [s] (400)")
    table.add_argument("--warm-up", type=float, metavar="S", help="time left out at its start [s] (100)")
    table.add_argument("--dtype", choices=("float64", "float32"), default="float64", help="plant precision")
    table.add_argument("--reference", metavar="NAME", help="contestant that ratios are over (lqg)")
    table.add_argument(
        "--clairvoyant",
        action="store_true",
        help="also the least cost of who knows each sea beforehand (linear payload; seconds for each sea)",
    )
    table.add_argument(
        "--oracle",
        action="store_true",
        help="also the cost of who knows what each episode draws (uncertainty)",
    )
    table.add_argument(
        "--workers",
        type=parsers.count,
        metavar="N",
        help="processes that run side by side (one for each processor)",
    )
    _add_other(table)
    table.add_argument(
        "--out", required=True, metavar="DIR", help="folder for the results; it resumes what it holds"
    )

    evaluated = verb(
        "evaluate",
        _evaluate,
        "run one agent in unseen seas of its scenario and print what it does, each training by itself",
        "heave evaluate zoo:limits_linear-rate --seeds 64",
        "heave evaluate runs/mine --scenario sea_state_5@rougher",
    )
    evaluated.add_argument(
        "agent", metavar="AGENT", help="zoo:NAME, zoo:NAME/SEED, a run folder, file:PATH.py or a design"
    )
    evaluated.add_argument(
        "--scenario", metavar="SCENARIO", help="name or YAML file (the one that the agent was trained in)"
    )
    _add_set(evaluated)
    evaluated.add_argument("--seeds", type=int, default=64, metavar="N", help="the first N test seas (64)")
    evaluated.add_argument(
        "--duration", type=parsers.seconds, metavar="S", help="length of an episode [s] (400)"
    )
    evaluated.add_argument("--warm-up", type=float, metavar="S", help="time left out at its start [s] (100)")
    evaluated.add_argument(
        "--dtype", choices=("float64", "float32"), default="float64", help="plant precision"
    )
    _add_other(evaluated)

    shipped = verb(
        "zoo",
        _zoo,
        "list the trained agents that are shipped, show one's card, add finished trainings, or measure anew",
        "heave zoo list",
        "heave zoo show limits_linear-rate",
        "heave zoo add runs/rate_0 runs/rate_1 --name limits_linear-rate",
        "heave zoo measure limits_linear-rate",
    )
    shipped.add_argument("action", choices=("list", "show", "add", "measure"), help="what to do")
    shipped.add_argument(
        "names", nargs="*", metavar="NAME|RUN", help="run folders for add; agents for show and measure (all)"
    )
    shipped.add_argument("--name", metavar="NAME", help="of add: the agent's name (SCENARIO-KIND)")
    shipped.add_argument(
        "--seas",
        type=int,
        default=None,
        metavar="N",
        help="of add and measure: the first N validation seas (64)",
    )
    shipped.add_argument(
        "--duration", type=parsers.seconds, metavar="S", help="likewise: length of an episode [s] (400)"
    )
    shipped.add_argument(
        "--rivals",
        metavar="A,B,...",
        help="likewise: designs to be held against (lqg, mpc and others that fit)",
    )
    shipped.add_argument(
        "--unmeasured",
        action="store_true",
        help="of add: only take the files; heave zoo measure does the rest",
    )

    report = verb(
        "report",
        _report,
        "draw the page of a comparison or league anew from its folder; nothing is simulated",
        "heave report runs/mine",
    )
    report.add_argument("folder", metavar="DIR", help="folder that heave compare, demo or league wrote")

    add_kinds(
        verb(
            "pictures",
            _pictures,
            "draw fronts, storms, learning curves, profiles and videos of what was run",
            *EXAMPLES,
        )
    )

    operable = verb(
        "operability",
        _operability,
        "in which seas of a scatter diagram work may go on, by controller, under limits of yours",
        "heave operability sea_state_5 --controllers none,lqg --limits payload_heave_std=0.1 --out runs/seas",
    )
    _add_scenario(operable)
    _add_set(operable)
    operable.add_argument(
        "--controllers",
        default="none,lqg",
        metavar="A,B,...",
        help="designs, agent:RUN and zoo:NAME, separated by commas (none,lqg)",
    )
    operable.add_argument(
        "--scatter",
        default="synthetic_scatter.csv",
        metavar="FILE.csv",
        help="significant_wave_height, peak_period and occurrence of each class (a computed example)",
    )
    operable.add_argument(
        "--limits",
        required=True,
        metavar="METRIC=VALUE,...",
        help="what a class must keep, in SI, as payload_heave_std=0.1,tension_peak=2e5",
    )
    operable.add_argument(
        "--quantile", type=float, metavar="Q", help="share of its seas that must keep them (their mean must)"
    )
    operable.add_argument(
        "--design",
        choices=("fixed", "each"),
        default="fixed",
        help="controllers designed once, for the scenario's own sea, or for each class (fixed)",
    )
    operable.add_argument(
        "--seeds", type=int, default=16, metavar="N", help="seas of each class: the first N test seas (16)"
    )
    operable.add_argument(
        "--duration", type=parsers.seconds, metavar="S", help="length of an episode [s] (400)"
    )
    operable.add_argument(
        "--out", required=True, metavar="DIR", help="folder for the results; it resumes what it holds"
    )

    identify = verb(
        "identify",
        _identify,
        "fit the thesis's second-order model, a x'' + b x' + x = x0 + u, to a scenario's cable",
        "heave identify thesis_cable --nonlinear",
    )
    _add_scenario(identify)
    _add_set(identify)
    identify.add_argument("--nonlinear", action="store_true", help="with quadratic damping, b x'|x'|")

    sea = verb(
        "sea",
        _sea,
        "a scenario's sea in numbers: shaping filters fitted to it and what they let one foresee",
        "heave sea thesis_linear --orders 4,6,8",
    )
    _add_scenario(sea)
    _add_set(sea)
    sea.add_argument("--orders", default="2,4,6,8,10", metavar="A,B,...", help="states of the filters")
    sea.add_argument(
        "--horizons", default="0.2,0.5,1,3", metavar="A,B,...", help="how far ahead to predict [s]"
    )

    cases = verb(
        "cases",
        _cases,
        "list the named cases of the solvers, or show one as YAML",
        "heave cases list",
        "heave cases show thesis_towed > mine.yaml",
    )
    cases.add_argument("action", choices=("list", "show"), help="what to do")
    cases.add_argument("case", nargs="?", metavar="CASE", help="name or YAML file, for show")
    cases.add_argument("--solver", metavar="NAME", help="list only the cases of this solver")
    _add_set(cases)

    solve = verb(
        "solve",
        _solve,
        "run a solver on a case: a lowering, a tow, a mooring, a span",
        "heave solve thesis_towed",
        "heave solve mine.yaml --set current.speed=[0.8] --out runs/tow",
    )
    solve.add_argument("case", metavar="CASE", help="name (heave cases list) or YAML file")
    _add_set(solve)
    solve.add_argument("--out", metavar="DIR", help="folder for numbers, tables and pictures")

    validate = verb(
        "validate",
        _validate,
        "hold every solver against closed forms, published figures, the others and an independent code",
        "heave validate --out runs/validation",
        "heave validate statics pendulum_period",
    )
    validate.add_argument("names", nargs="*", metavar="NAME", help="cases or solvers (all)")
    validate.add_argument("--fast", action="store_true", help="leave out what takes more than a few seconds")
    validate.add_argument("--list", action="store_true", dest="listed", help="list the cases, run none")
    validate.add_argument("--anew", action="store_true", help="run again what the folder holds")
    validate.add_argument(
        "--out", default="runs/validation", metavar="DIR", help="folder for page and tables (runs/validation)"
    )

    reproduce = verb(
        "reproduce",
        _reproduce,
        "draw the sources' figures anew",
        'heave reproduce "H 3" "B 9-2" --out runs/gallery',
    )
    reproduce.add_argument("labels", nargs="*", metavar="FIGURE", help="figures or chapters (all)")
    reproduce.add_argument("--list", action="store_true", dest="listed", help="list the figures, draw none")
    reproduce.add_argument("--anew", action="store_true", help="draw again what the folder holds")
    reproduce.add_argument(
        "--out", default="runs/gallery", metavar="DIR", help="folder for the pictures (runs/gallery)"
    )

    bench = verb(
        "bench",
        _bench,
        "measure speed beside yardsticks, on one core, in one run",
        "heave bench --json bench.json",
    )
    bench.add_argument("--json", metavar="FILE", help="write every figure with its yardstick and ratio")
    bench.add_argument(
        "--markdown", action="store_true", help="print the tables as docs/benchmark.md has them"
    )
    bench.add_argument("--lines", action="store_true", help="the line in three dimensions beside MoorDyn")
    bench.add_argument(
        "--gpu",
        nargs="?",
        const="cuda",
        metavar="DEVICE",
        help="the plant on a GPU (cuda, cuda:1, ...; cpu tries the same kernel on the processor)",
    )
    bench.add_argument("--quick", action="store_true", help="short measurements: a smoke test")
    return top


def _add_scenario(made: Parser) -> None:
    made.add_argument("scenario", metavar="SCENARIO", help="name (heave scenarios list) or YAML file")


def _add_set(made: Parser) -> None:
    made.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY.PATH=VALUE",
        dest="settings",
        help="change a value of the scenario, as winch.command_delay=0.4; may be repeated",
    )


def _add_other(made: Parser) -> None:
    made.add_argument(
        "--allow-other-scenario",
        action="store_true",
        help="let an agent act in a scenario it was not trained for, if it sees the same",
    )


def scenario_of(name: str, settings: Sequence[str] = ()) -> Scenario:
    """The scenario of that name or file, with values replaced by `key.path=value` settings.

    Raises:
        ValueError: If there is none, or a setting is impossible.
    """
    scenario = scenarios.load(name)
    values = dict(_settings(settings, "winch.command_delay=0.4"))
    return scenarios.with_values(scenario, values) if values else scenario


def _settings(settings: Sequence[str], example: str) -> list[tuple[str, Any]]:
    """Dotted path and value of each `key.path=value`."""
    pairs = []
    for setting in settings:
        path, equals, text = setting.partition("=")
        if not equals or not path.strip():
            raise ValueError(f"--set wants KEY.PATH=VALUE, as {example}, got {setting!r}")
        pairs.append((path.strip(), _value(setting, text)))
    return pairs


def _value(setting: str, text: str) -> Any:
    import yaml

    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ValueError(f"--set {setting!r}: the value is not valid YAML") from error
    if isinstance(value, str):
        # YAML 1.1 takes 1e4 for a word, for want of a point; a user means the number.
        try:
            return float(value)
        except ValueError:
            return value
    return value


# What is done ------------------------------------------------------------------------------------


def _console(**options: Any) -> Any:
    from rich.console import Console

    return Console(highlight=False, **options)


class Bars:
    """A progress bar on a terminal's stderr per scenario and controller.

    They appear with the first step, so that a training before it can draw its own.
    """

    def __init__(self) -> None:
        self.drawn: Any = None
        self.tasks: dict[tuple[str, str], Any] = {}

    def __enter__(self) -> Bars:
        return self

    def __call__(self, scenario: str, label: str, count: float, total: int) -> None:
        """Advances the bar of a scenario and controller by `count` of `total`."""
        if self.drawn is None:
            from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

            console = _console(stderr=True)
            self.drawn = Progress(
                TextColumn("{task.description}", markup=False),
                BarColumn(),
                TaskProgressColumn(),
                TimeRemainingColumn(),
                console=console,
                transient=True,
                disable=not console.is_terminal,
            )
            self.drawn.start()
        key = (scenario, label)
        if key not in self.tasks:
            self.tasks[key] = self.drawn.add_task(f"{scenario}: {label}", total=total)
        self.drawn.advance(self.tasks[key], count)

    def __exit__(self, *error: object) -> None:
        if self.drawn is not None:
            self.drawn.stop()


def _demo(options: argparse.Namespace) -> None:
    from experiments.demo import N_SEEDS, demo

    note = _console(stderr=True)
    with Bars() as advance:
        out = demo(
            options.out,
            n_seeds=N_SEEDS if options.seeds is None else options.seeds,
            total_steps=options.steps,
            seed=options.seed,
            duration=options.duration,
            arguments=options.arguments,
            announce=lambda line: note.print(line, markup=False),
            progress=advance,
        )
    _print_tables(out)


def _scenarios(options: argparse.Namespace) -> None:
    if options.action == "show":
        if options.scenario is None:
            raise ValueError(
                "scenarios show wants the name of a scenario; list them with heave scenarios list"
            )
        print(scenarios.to_yaml(scenario_of(options.scenario, options.settings)), end="")
        return
    if options.action == "page":
        _scenario_pages(options)
        return
    if options.scenario is not None or options.settings:
        raise ValueError("scenarios list takes no scenario and no --set; heave scenarios show does")
    found = scenarios.names(options.tag)
    if not found:
        tags = sorted({tag for name in scenarios.names() for tag in scenarios.load(name).tags})
        raise ValueError(f"no scenario has the tag {options.tag!r}; tags: {', '.join(tags)}")
    from rich.table import Table

    from experiments.scenario_pages import variant_rows

    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 1, 0))
    table.add_column("name", no_wrap=True)
    for heading in ("plant", "sea", "delay", "sees", "tags"):
        table.add_column(heading)
    table.add_column("description", ratio=1, min_width=30)
    for name in found:
        scenario = scenarios.load(name)
        sea = scenario.sea_state
        plant = "linear payload" if scenario.is_linear else f"{scenario.initial_length:.4g} m cable"
        table.add_row(
            name,
            plant,
            f"{sea.kind.replace('_', ' ')}, Hs {sea.significant_wave_height:.3g} m",
            f"{scenario.winch.command_delay:g} s",
            scenario.information_set.replace("_", " "),
            ", ".join(scenario.tags),
            scenario.description,
        )
    console = _console(width=None if sys.stdout.isatty() else 160)
    console.print(table)
    variants = _table(
        "variant, as NAME@rougher",
        "what is other for the plant",
        "not of",
        wide="what is other for the plant",
    )
    for row in variant_rows():
        variants.add_row(*row)
    console.print(variants, markup=False)


def _scenario_pages(options: argparse.Namespace) -> None:
    from experiments.scenario_pages import NOTES, write_page

    if options.settings:
        raise ValueError("scenarios page takes no --set: a page is of a named scenario as it is")
    note = _console(stderr=True)
    controllers = None if options.controllers is None else options.controllers.split(",")
    for name in NOTES if options.scenario is None else [options.scenario]:

        def told(what: str, name: str = name) -> None:
            note.print(f"{name}: {what}", markup=False)

        page = write_page(
            name,
            options.out,
            n_seeds=options.seeds,
            controllers=controllers,
            duration=options.duration,
            progress=told,
        )
        print(page)


def _simulate(options: argparse.Namespace) -> None:
    from experiments.simulate import early_end, simulate

    scenario = scenario_of(options.scenario, options.settings)
    trajectory = simulate(
        scenario,
        out=options.out,
        controller=options.controller,
        seed=options.seed,
        motion=options.motion,
        duration=options.duration,
        allow_other_scenario=options.allow_other_scenario,
        arguments=options.arguments,
    )
    ended = early_end(trajectory)
    if ended is not None:
        print(f"heave: the run ended early: {ended}", file=sys.stderr)
    n_rows = int(trajectory.n_valid[0]) + 1
    print(f"{options.out}: {n_rows} rows, {trajectory.time[n_rows - 1]:g} s of {scenario.name}")


def _table(*headings: str, wide: str) -> Any:
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
    for heading in headings:
        table.add_column(heading, ratio=1 if heading == wide else None, no_wrap=heading == headings[0])
    return table


def _print(table: Any) -> None:
    # Units stand in brackets, which Rich would take for its markup.
    _console(width=None if sys.stdout.isatty() else 160, markup=False).print(table)


def _cases(options: argparse.Namespace) -> None:
    from experiments import solve

    if options.action == "show":
        if options.case is None:
            raise ValueError("cases show wants the name of a case; list them with heave cases list")
        settings = _settings(options.settings, "cable.diameter=0.02")
        print(solve.to_yaml(*solve.load(options.case, settings)), end="")
        return
    if options.case is not None or options.settings:
        raise ValueError("cases list takes no case and no --set; heave cases show does")
    found = [item for item in solve.named_cases().values() if options.solver in (None, item.solver)]
    if not found:
        known = sorted({item.solver for item in solve.named_cases().values()})
        raise ValueError(f"no case is of the solver {options.solver!r}; solvers: {', '.join(known)}")
    table = _table("name", "solver", "description", wide="description")
    for item in found:
        table.add_row(item.name, item.solver, item.description)
    _print(table)


def _solve(options: argparse.Namespace) -> None:
    from experiments import solve
    from experiments.report import significant

    named, parameters = solve.load(options.case, _settings(options.settings, "cable.diameter=0.02"))
    outcome = solve.solve(named, parameters, options.out, options.arguments)
    table = _table("quantity", "value", "unit", "meaning", wide="meaning")
    for item in outcome.quantities:
        table.add_row(item.name, significant(item.value, 5), item.unit, item.meaning)
    _print(table)
    if options.out is not None:
        print(f"{options.out}: {len(outcome.tables)} tables, {len(outcome.pictures)} pictures")


def _validate(options: argparse.Namespace) -> None:
    from experiments import validate

    cases = validate.chosen(options.names, fast=options.fast)
    if options.listed:
        table = _table("case", "solver", "evidence", "speed", "what is compared", wide="what is compared")
        for case in cases:
            table.add_row(case.name, case.room, case.evidence, "slow" if case.slow else "fast", case.summary)
        _print(table)
        return
    with Bars() as advance:
        everything = validate.validate(
            options.out,
            cases,
            anew=options.anew,
            arguments=options.arguments,
            progress=lambda name: advance("validate", "cases", 1, len(cases)),
        )
    _print(_every_check(everything) if options.names else _every_case(everything))
    failures = validate.failed(everything)
    n_checks = sum(len(found["checks"]) for found in everything)
    verdict = f"failed: {', '.join(failures)}" if failures else "all passed"
    print(f"{n_checks} checks in {len(cases)} cases, {verdict}; {options.out}/{validate.PAGE_FILE}")
    options.exit_code = FAILED if failures else 0


def _every_check(everything: Sequence[dict[str, Any]]) -> Any:
    """A row for each number of each case."""
    from experiments.validate import error_text, number_text, tolerance_text

    table = _table("case", "quantity", "ours", "reference", "error", "tolerance", "", wide="quantity")
    for found in everything:
        if found["skipped"]:
            table.add_row(found["name"], f"skipped: {found['skipped']}")
        for check in found["checks"]:
            numbers = (number_text(check["ours"]), number_text(check["reference"]))
            errors = (error_text(check), tolerance_text(check))
            verdict = "passed" if check["passed"] else "FAILED"
            table.add_row(found["name"], check["quantity"], *numbers, *errors, verdict)
        for item in found["unmatched"]:
            said = f"{item['quantity']}: {item['reason']}"
            table.add_row(
                found["name"],
                said,
                number_text(item["ours"]),
                number_text(item["published"]),
                "",
                "",
                "unmatched",
            )
    return table


def _every_case(everything: Sequence[dict[str, Any]]) -> Any:
    """A row for each case; what failed is told in full."""
    from experiments.validate import failed

    table = _table("case", "checks", "", wide="")
    for found in everything:
        lost = [check["quantity"] for check in found["checks"] if not check["passed"]]
        verdict = "FAILED" if failed([found]) else "passed"
        if found["skipped"]:
            verdict = f"skipped: {found['skipped']}"
        elif found["unmatched"]:
            verdict += f"; {len(found['unmatched'])} published numbers unmatched"
        said = f"{verdict}: {'; '.join(lost)}" if lost else verdict
        table.add_row(found["name"], str(len(found["checks"])), said)
    return table


def _reproduce(options: argparse.Namespace) -> None:
    from experiments import reproduce

    wanted = reproduce.chosen(options.labels)
    if options.listed:
        table = _table("figure", "what it shows", wide="what it shows")
        for item in wanted:
            table.add_row(item.label, item.title)
        _print(table)
        return
    with Bars() as advance:
        page = reproduce.reproduce(
            options.out,
            wanted,
            anew=options.anew,
            progress=lambda label: advance("reproduce", "figures", 1, len(wanted)),
        )
    print(f"{page}: {len(wanted)} figures")


def _train(options: argparse.Namespace) -> None:
    from agents.train import train

    scenario = scenario_of(options.scenario, options.settings)
    if options.preset is not None and options.preset.startswith("zoo:"):
        from agents.zoo import preset_of

        options.preset = preset_of(options.preset)
    run = train(
        scenario,
        algorithm=options.algorithm,
        seed=options.seed,
        total_steps=options.steps,
        out=options.out,
        preset=options.preset,
        arguments=options.arguments,
    )
    print(
        f"{run}: compare it with\n"
        f"  heave compare {options.scenario} --controllers none,lqg,agent:{run} --out DIR"
    )


def _sweep(options: argparse.Namespace) -> None:
    from experiments.report import significant
    from experiments.sweep import TABLE_FILE, differing, sweep

    with Bars() as advance:
        found = sweep(
            options.file,
            out=options.out,
            address=options.address,
            workers=options.workers,
            arguments=options.arguments,
            progress=lambda count, total: advance("sweep", "trainings", count, total),
        )
    table = _table(
        "scenario",
        "algorithm",
        "kind",
        "seed",
        "settings that differ",
        "steps",
        "wall [s]",
        "validation cost",
        wide="settings that differ",
    )
    for row, told in zip(found.rows, differing(found.rows), strict=True):
        cost = row["status"] if row["validation_cost"] is None else significant(row["validation_cost"], 4)
        settings = (row["seed"], told, row["steps"], row["wall_s"])
        table.add_row(row["scenario"], row["algorithm"], row["kind"], *map(str, settings), cost)
    _print(table)
    for folder, reason in found.failures.items():
        print(f"heave: {folder}: {' '.join(reason.split())}", file=sys.stderr)
    if found.best is not None:
        value, trial = found.best["value"], found.best["trial"]
        print(f"best of the search: {value:.5g}, trial {trial}: {json.dumps(found.best['overrides'])}")
    if found.n_skipped:
        print(f"{found.n_skipped} trainings were finished before")
    print(found.speed)
    print(f"table: {found.folder / TABLE_FILE}")
    options.exit_code = FAILED if found.failures else 0


def _compare(options: argparse.Namespace) -> None:
    from experiments.compare import compare

    chosen = [scenario_of(name, options.settings) for name in options.scenario]
    with Bars() as advance:
        out = compare(
            chosen,
            options.controllers.split(","),
            n_seeds=options.seeds,
            out=options.out,
            duration=options.duration,
            warm_up=options.warm_up,
            dtype=options.dtype,
            reference=options.reference,
            allow_other_scenario=options.allow_other_scenario,
            clairvoyant=options.clairvoyant,
            oracle=options.oracle,
            arguments=options.arguments,
            progress=advance,
        )
    _print_tables(out)


def _league(options: argparse.Namespace) -> None:
    from experiments import league, league_page, runs

    chosen = [scenario_of(name, options.settings) for name in options.scenario]
    with Bars() as advance:
        out = league.league(
            chosen,
            options.controllers.split(","),
            n_seeds=options.seeds,
            out=options.out,
            variants=options.variants,
            duration=options.duration,
            warm_up=options.warm_up,
            dtype=options.dtype,
            reference=options.reference,
            zoo=options.zoo,
            workers=options.workers,
            allow_other_scenario=options.allow_other_scenario,
            clairvoyant=options.clairvoyant,
            oracle=options.oracle,
            arguments=options.arguments,
            progress=advance,
        )
    for line in league.printed(runs.read_json(out / league_page.SUMMARY_FILE)):
        print(line)
    print(f"leaderboard: {out / league_page.PAGE_FILE}")


def _evaluate(options: argparse.Namespace) -> None:
    from experiments.evaluate import SHOWN, evaluate
    from experiments.metrics import METRICS
    from experiments.report import significant

    if options.settings and options.scenario is None:
        raise ValueError("--set wants the scenario that it changes; name it with --scenario")
    scenario = None if options.scenario is None else scenario_of(options.scenario, options.settings)
    with Bars() as advance:
        found = evaluate(
            options.agent,
            scenario=scenario,
            n_seeds=options.seeds,
            duration=options.duration,
            warm_up=options.warm_up,
            dtype=options.dtype,
            allow_other_scenario=options.allow_other_scenario,
            progress=advance,
        )
    part, result = found.cell.contest.part, next(iter(found.cell.results.values()))
    table = _table("quantity", "unit", "mean", "95 % interval", "median", "95 %", "maximum", wide="")
    whole = found.quantities()
    for name in (name for name in SHOWN if name in whole):
        item = whole[name]
        interval = "" if item.low is None else f"{significant(item.low)} to {significant(item.high)}"
        spread = [significant(whole[f"{name}_{key}"].value) for key in ("median", "p95", "maximum")]
        table.add_row(name, METRICS[name].unit, significant(item.value), interval, *spread)
    _print(table)
    trainings = found.trainings if len(found.trainings) > 1 else ()
    if trainings:
        each = _table(
            "training", "J", "J, maximum", "payload std [mm]", "control energy [m²]", "failed", wide=""
        )
        for i, label in enumerate(trainings):
            row = found.quantities(i)
            each.add_row(
                label,
                significant(row["cost"].value, 4),
                significant(row["cost_maximum"].value),
                significant(1e3 * row["payload_heave_std"].value),
                significant(row["control_energy"].value),
                str(row["diverged"].value + row["lost"].value),
            )
        _print(each)
    ends = [f"{whole[end].value} {end}" for end in ("diverged", "lost", "landed") if whole[end].value]
    optimum = whole.get("cost_ratio_to_optimum")
    facts = [
        f"{len(found.seeds)} unseen seas of {found.cell.contest.scenario.name}",
        f"{part.scored:g} s after {part.warm_up:g} s",
        f"sees {result.information_set.replace('_', ' ')}",
        f"{1e6 * result.decision_time:.3g} µs per decision and sea",
        *([] if optimum is None else [f"J / optimum {optimum.value:.4g}"]),
        "no sea diverged or was lost" if not ends else "of all trainings' seas " + ", ".join(ends),
    ]
    print(f"{found.spec}: {'; '.join(facts)}")


def _zoo(options: argparse.Namespace) -> None:
    from agents import zoo
    from experiments import zoo as results

    given = {"--name": options.name, "--seas": options.seas, "--duration": options.duration}
    given |= {"--rivals": options.rivals, "--unmeasured": options.unmeasured or None}
    fits = {"add": set(given), "measure": {"--seas", "--duration", "--rivals"}}.get(options.action, set())
    for option, value in given.items():
        if value is not None and option not in fits:
            raise ValueError(f"zoo {options.action} takes no {option}")
    if options.action == "list":
        if options.names:
            raise ValueError("zoo list takes no name; heave zoo show does")
        table = _table("name", "scenario", "kind", "guide", "sees", "seeds", "J", "size [kB]", wide="J")
        agents = [zoo.read(name) for name in zoo.names()]
        for agent in agents:
            card = agent.card
            facts = (card["scenario_name"], f"{card['algorithm']} {card['agent']}", card["guide"] or "")
            size = f"{agent.size / 1e3:.0f}"
            sees = card["information_set"].replace("_", " ")
            table.add_row(agent.name, *facts, sees, str(len(agent.seeds)), results.ratios_text(agent), size)
        _print(table)
        whole = sum(agent.size for agent in agents)
        print(
            f"{len(agents)} agents, {whole / 1e6:.2f} of {zoo.LARGEST / 1e6:g} MB; J: mean over all "
            "trainings, the worst training in brackets, in validation seas"
        )
        return
    if options.action == "show":
        if len(options.names) != 1:
            raise ValueError("zoo show wants the name of one agent; list them with heave zoo list")
        for line in results.card_lines(zoo.read(options.names[0].removeprefix(zoo.PREFIX))):
            print(line)
        return
    if options.action == "add":
        agents = [zoo.add(options.names, options.name)]
        print(f"{agents[0].name}: {len(agents[0].seeds)} seeds in {agents[0].folder}")
    else:
        agents = [zoo.read(name.removeprefix(zoo.PREFIX)) for name in options.names or zoo.names()]
    with Bars() as advance:
        for agent in agents if not options.unmeasured else ():
            agent = results.measure(
                agent,
                n_seas=results.N_SEAS if options.seas is None else options.seas,
                duration=options.duration,
                rivals=None if options.rivals is None else options.rivals.split(","),
                progress=advance,
            )
            print(f"{agent.name}: J {results.ratios_text(agent)}")


def _print_tables(out: Path) -> None:
    """Prints the main numbers of a comparison's folder, and where the report lies."""
    from rich.markup import escape
    from rich.table import Table

    from experiments import runs
    from experiments.metrics import SCORED, WARM_UP
    from experiments.report import ended_early, load, significant, with_interval

    run, found = load(out)
    console = _console(width=None if sys.stdout.isatty() else 160)
    for name, item in found["scenarios"].items():
        table = Table(header_style="bold", title_justify="left", title_style="bold")
        table.title = (
            f"{name}: {run['n_seeds']} unseen seas, {item['scored']:g} s after {item['warm_up']:g} s, "
            f"delay {item['command_delay']:g} s"
        )
        over_oracle = ("J / oracle",) if item.get("oracles") else ()
        for heading in (
            "controller",
            "sees",
            "payload std [mm]",
            "maximum",
            "removed of boom tip [%]",
            "control energy [m²]",
            "cost J",
            "J / optimum",
            *over_oracle,
            "ended early",
        ):
            shape: Any = "left" if heading in ("controller", "sees") else "right"
            table.add_column(escape(heading), justify=shape)
        for label, entry in item["controllers"].items():
            metrics = entry["metrics"]
            table.add_row(
                escape(label),
                entry["information_set"].replace("_", " "),
                with_interval(metrics["payload_heave_std"], 1e3),
                significant(1e3 * (metrics["payload_heave_std"]["maximum"] or 0.0)),
                with_interval(metrics["efficiency_boom_tip"], 1e2),
                with_interval(metrics["control_energy"]),
                with_interval(metrics["cost"]),
                with_interval(metrics.get("cost_ratio_to_optimum")),
                *(with_interval(metrics["cost_over_oracle"]) for _ in over_oracle),
                ended_early(metrics),
            )
        console.print(table)
        for label, cost in item.get("oracles", {}).items():
            console.print(
                f"yardstick {label}, who knows what each episode drew: cost J {with_interval(cost)}"
            )
        if item["warm_up"] < WARM_UP or item["scored"] < SCORED:
            console.print(
                f"The episode is shorter than the protocol's {WARM_UP + SCORED:g} s: {item['scored']:g} s "
                f"were scored after {item['warm_up']:g} s of warm-up.",
                markup=False,
            )
    print(f"report: {out / runs.REPORT_FILE}")


def _operability(options: argparse.Namespace) -> None:
    from experiments import operability, runs
    from experiments.operability_page import share_text, too_few

    scenario = scenario_of(options.scenario, options.settings)
    with Bars() as advance:
        out = operability.operability(
            scenario,
            options.controllers.split(","),
            limits=options.limits,
            n_seeds=options.seeds,
            out=options.out,
            scatter=options.scatter,
            quantile=options.quantile,
            design=options.design,
            duration=options.duration,
            arguments=options.arguments,
            progress=lambda label, count, total: advance(scenario.name, label, count, total),
        )
    told = runs.read_json(out / operability.SUMMARY_FILE)
    alone = [f"if only {metric} [%]" for metric in told["limits"]]
    table = _table("controller", "operable [%]", *alone, "classes", "undecided", "seas failed", wide="")
    for label, item in told["controllers"].items():
        shares = [f"{value:.1f}" for value in item["limits"].values()]
        counts = (f"{item['n_operable']} of {told['n_cells']}", item["n_undecided"], item["n_failed"])
        table.add_row(label, share_text(item), *shares, *map(str, counts))
    _print(table)
    print(
        f"{told['n_cells']} classes of {told['scatter']}, {told['n_seeds']} seas each, by their "
        f"{told['statistic']}: {out / operability.PAGE_FILE}"
    )
    if too_few(told):
        print(too_few(told))


def _report(options: argparse.Namespace) -> None:
    from experiments.report import write_report

    print(f"report: {write_report(options.folder)}")


def _pictures(options: argparse.Namespace) -> None:
    from experiments import pictures_cli

    scenario = None
    if pictures_cli.names_scenario(options):
        scenario = scenario_of(options.source, options.settings)
    with Bars() as advance:
        for path in pictures_cli.draw(options, scenario=scenario, progress=advance):
            print(path)


def _identify(options: argparse.Namespace) -> None:
    from baselines.identification import identified
    from heave_env.provenance import commit

    scenario = scenario_of(options.scenario, options.settings)
    fit = identified(scenario, nonlinear=options.nonlinear)
    damping = "b x'|x'|" if options.nonlinear else "b x'"
    unit = "s²/m" if options.nonlinear else "s"
    print(f"{scenario.name} (fingerprint {scenario.fingerprint}, commit {commit()})")
    print(f"a x'' + {damping} + x = x0 + u")
    print(f"a = {fit.inertia:.6g} s²")
    print(f"b = {fit.damping:.6g} {unit}")
    print(f"residual std {fit.residual_std:.3g} m of {fit.response_std:.3g} m")


def _sea(options: argparse.Namespace) -> None:
    from experiments.sea import sea_page
    from heave_env.provenance import commit

    try:
        orders = [int(text) for text in options.orders.split(",")]
        horizons = [float(text) for text in options.horizons.split(",")]
    except ValueError as error:
        raise ValueError(f"--orders and --horizons take numbers separated by commas: {error}") from error
    scenario = scenario_of(options.scenario, options.settings)
    print(f"{scenario.name} (fingerprint {scenario.fingerprint}, commit {commit()})")
    print(sea_page(scenario, orders, horizons))


def _bench(options: argparse.Namespace) -> None:
    from experiments import runs
    from experiments.benchmark import markdown, measure, tables

    if options.json is not None:
        runs.check_file(options.json)
    if options.lines:
        from experiments.line_benchmark import line_figures, line_speeds, line_table

        speeds = line_speeds()
        print("\n".join(line_table(speeds)))
        if options.json is not None:
            print(f"figures: {runs.write_json(options.json, line_figures(speeds, options.arguments))}")
        return
    console = _console(stderr=True)
    if options.gpu is not None:
        from experiments.gpu_benchmark import gpu_table, measure_gpu

        found = measure_gpu(
            options.gpu,
            quick=options.quick,
            arguments=options.arguments,
            announce=lambda line: console.print(line, markup=False),
        )
        print("\n".join(gpu_table(found)))
        if options.json is not None:
            print(f"figures: {runs.write_json(options.json, found)}")
        return
    found = measure(
        quick=options.quick,
        arguments=options.arguments,
        announce=lambda line: console.print(line, markup=False),
    )
    for line in markdown(found) if options.markdown else tables(found):
        print(line)
    if options.json is not None:
        print(f"figures: {runs.write_json(options.json, found)}")


if __name__ == "__main__":
    raise SystemExit(main())
