"""Presets: the settings of a training, read from plain YAML files, one per algorithm.

A file holds `default`, and under `scenarios` what differs in a named scenario. A user's own file or
mapping goes on top. Unknown keys are refused.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents.guide import MODES
from agents.tension_cost import TensionCost
from heave_env.parameters import name_hint, require, require_integer, require_number
from heave_env.scenarios import Scenario
from heave_env.sensors import INFORMATION_SETS

ALGORITHMS = ("ppo", "recurrent_ppo", "sac", "td3", "tqc")
"""Algorithms that have presets."""
KINDS = ("residual", "estimate", "rate", "taught")
"""Kinds of agent beside that from sensors; their presets, as `ppo_residual.yaml`, go on the algorithm's. Not
every algorithm has one for each (`kinds_of`)."""
PRESET_FOLDER = Path(__file__).parent / "presets"
"""Where the presets lie, a YAML file per algorithm."""


@dataclass(frozen=True, kw_only=True)
class Preset:
    """Settings of one training."""

    algorithm: str
    """One of `ALGORITHMS`."""
    total_steps: int
    """Environment steps of the whole training [-]; 0: the imitation of a teacher is all of it."""
    n_envs: int
    """Environments in the batch [-]."""
    information_set: str | None = None
    """What the agent sees; null: what the scenario says."""
    history_lags: tuple[int, ...] | None = None
    """Ages of the samples in `sensors_history` [control steps]; null: what the scenario says."""
    reference: str | None = None
    """Designed controller under which the observations' covariance is gathered that whitens the agent's
    input; null: random commands alone."""
    warm_start: bool = False
    """Whether the policy starts as the linear fit of the reference's action to what the agent sees; false:
    it starts by doing nothing."""
    guide: str | None = None
    """Designed controller with a Kalman filter whose estimate the agent sees beside its observation; null:
    none."""
    guide_mode: str = "residual"
    """What the agent's action is beside a guide: `residual`, added to the guide's command, `estimate`, the
    command, or `rate`, the drum's rate when the command arrives (`agents.guide`)."""
    guide_reach: float = 0.1
    """Share of the command range that a residual action of one adds, or of the fastest rate that it means
    [-]."""
    guide_rest: float = 0.0
    """Actions within ± this leave the drum at rest in the mode `rate` [-]."""
    guide_shown: bool = True
    """Whether the agent sees the guide's estimate; false: the sensors alone, and the guide only turns its
    action into a command."""
    privileged_critic: bool = False
    """Whether the critic sees the plant's true state and parameters, PPO alone; the actor never does."""
    logarithmic_reward: bool = False
    """Whether the logarithm of the stage cost is learned from: where parameters are unknown a few rough
    episodes would rule the mean."""
    tension_cost: float = 0.0
    """What the agent is charged in training for high tensions in the cable, `TensionCost.weight` [-]; the
    policy that is kept is the best by the cost with this charge. 0: nothing."""
    tension_above: float = 1.0
    """From where on, in tensions of the line at rest [-]."""
    teacher: str | None = None
    """Whose commands the actor is fitted to before it learns: a designed controller with a Kalman filter, or
    `oracle` or `oracle_mpc`, who know what each episode drew; null: nobody's."""
    lessons: int = 8
    """Rounds of that imitation [-]."""
    lesson_seas: int = 120
    """Seas driven side by side in each of them [-]."""
    lesson_epochs: int = 5
    """Passes over everything gathered so far after each of them, five times as many after the last [-]."""
    take_over: float | None = None
    """How far the agent's action may miss the teacher's in them, over the root mean square of that, before
    the teacher acts in its place [-]; null: however far."""
    repeat_worst: float = 0.0
    """Share of a lesson's seas that are those of earlier ones in which the agent missed most [-]."""
    excitation: float = 0.05
    """Deviation of the white noise on the action while that covariance is gathered [command range]."""
    feature_bound: float = 15.0
    """Whitened components are cut off at ± this [-]."""
    hidden: tuple[int, ...]
    """Widths of the actor's hidden layers [-]."""
    critic_hidden: tuple[int, ...]
    """Widths of the critic's hidden layers [-]."""
    activation: str = "tanh"
    """Between the layers: `tanh` or `relu`."""
    learning_rate: float
    """At the beginning [-]."""
    final_learning_rate: float = 0.0
    """At the end, reached linearly [-]."""
    gamma: float
    """Discount per control step [-]."""
    critic_first: int = 0
    """Environment steps in which the actor stands still while the critic learns [-]: an untrained critic
    would undo a warm start."""
    critic_epochs: int = 1
    """Times as many epochs as later that PPO's critic goes through each rollout while the actor stands still
    [-]."""
    reward_horizon: float = 500.0
    """Steps of the batch over which the reward's running mean and scale forget [-]."""
    reward_bound: float = 2.0
    """Scaled rewards are cut off at ± this [-]."""
    burn_in: float = 20.0
    """Time after the beginning of an episode that earns no reward [s]: the start from rest dies out."""
    mean_life: float = 2560.0
    """Control steps that a row stays in one sea on average before it is given a new one [-]."""
    evaluate_every: int = 500_000
    """Environment steps between evaluations on validation seas [-]."""
    evaluation_seas: int = 32
    """Validation seas [-]."""
    evaluation_duration: float = 200.0
    """Length of an evaluation's episodes, at most the scenario's own [s]."""
    checkpoint_every: int = 1_000_000
    """Environment steps between the policies kept in `checkpoints/` [-]."""
    log_every: int = 65_536
    """Environment steps between rows of `progress.csv` and TensorBoard [-]."""
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """Handed to Stable-Baselines3's algorithm as they are."""

    def __post_init__(self) -> None:
        require(self.algorithm in ALGORITHMS, self, "algorithm", f"one of {', '.join(ALGORITHMS)}")
        require(self.activation in ("tanh", "relu"), self, "activation", "tanh or relu")
        known = (None, *INFORMATION_SETS)
        require(
            self.information_set in known, self, "information_set", f"one of {', '.join(INFORMATION_SETS)}"
        )
        counts = (
            "n_envs",
            "lessons",
            "lesson_seas",
            "lesson_epochs",
            "evaluate_every",
            "evaluation_seas",
            "checkpoint_every",
            "log_every",
            "critic_epochs",
        )
        for field in counts:
            require_integer(self, field, minimum=1)
        require_integer(self, "total_steps", minimum=0)
        for field in (
            "learning_rate",
            "feature_bound",
            "reward_horizon",
            "reward_bound",
            "mean_life",
            "evaluation_duration",
        ):
            require_number(self, field, positive=True)
        for field in ("final_learning_rate", "burn_in", "tension_cost", "tension_above"):
            require_number(self, field, non_negative=True)
        for field in ("warm_start", "guide_shown", "privileged_critic", "logarithmic_reward"):
            require(isinstance(getattr(self, field), bool), self, field, "true or false")
        require(self.guide_mode in MODES, self, "guide_mode", f"one of {', '.join(MODES)}")
        require_number(self, "guide_reach", positive=True)
        require_number(self, "guide_rest", non_negative=True)
        require(self.guide_rest < 1.0, self, "guide_rest", "below 1")
        require(
            self.algorithm == "ppo" or not self.privileged_critic,
            self,
            "privileged_critic",
            "false for every algorithm but ppo",
        )
        require(
            self.total_steps > 0 or self.teacher is not None,
            self,
            "total_steps",
            "positive without a teacher: nothing would be learned",
        )
        require_number(self, "repeat_worst", non_negative=True)
        require(self.repeat_worst < 1.0, self, "repeat_worst", "below 1")
        if self.take_over is not None:
            require_number(self, "take_over", positive=True)
        require_number(self, "gamma", positive=True)
        require(self.gamma < 1.0 or math.isclose(self.gamma, 1.0), self, "gamma", "at most 1")
        for field in ("hidden", "critic_hidden"):
            widths = getattr(self, field)
            ok = isinstance(widths, tuple) and all(isinstance(n, int) and n > 0 for n in widths)
            require(ok and len(widths) > 0, self, field, "a list of positive whole numbers")

    @property
    def charge(self) -> TensionCost | None:
        """What the agent is charged beside the task's cost."""
        if self.tension_cost == 0.0:
            return None
        return TensionCost(weight=self.tension_cost, above=self.tension_above)

    def to_mapping(self) -> dict[str, Any]:
        """The preset as plain JSON values."""
        mapping = dataclasses.asdict(self)
        return {key: list(value) if isinstance(value, tuple) else value for key, value in mapping.items()}


def kinds_of(algorithm: str) -> tuple[str, ...]:
    """The kinds of agent that an algorithm has presets for, beside that from sensors."""
    return tuple(kind for kind in KINDS if (PRESET_FOLDER / f"{algorithm}_{kind}.yaml").is_file())


def load_preset(
    algorithm: str, scenario: Scenario, overrides: Mapping[str, Any] | str | Path | None = None
) -> Preset:
    """The preset of an algorithm in a scenario, with a user's own settings on top.

    Args:
        algorithm: One of `ALGORITHMS`.
        scenario: The scenario to train in; its name selects what differs from the default.
        overrides: Settings by key, a YAML file of them, or one of `KINDS`; `options` are merged key by key.

    Raises:
        ValueError: If the algorithm, a key or a value is unknown or impossible.
    """
    if algorithm not in ALGORITHMS:
        raise ValueError(f"algorithm must be one of {', '.join(ALGORITHMS)}, got {algorithm!r}")
    layers = _layers(PRESET_FOLDER / f"{algorithm}.yaml", scenario)
    if isinstance(overrides, str) and overrides in KINDS:
        if overrides not in kinds_of(algorithm):
            others = [other for other in ALGORITHMS if overrides in kinds_of(other)]
            raise ValueError(
                f"preset {overrides!r} is not one of {algorithm}'s: choose the algorithm "
                f"{' or '.join(others)}"
            )
        layers += _layers(PRESET_FOLDER / f"{algorithm}_{overrides}.yaml", scenario)
    elif isinstance(overrides, (str, Path)):
        layers.append(_read(Path(overrides)))
    elif overrides is not None:
        layers.append(dict(overrides))
    known = {field.name for field in dataclasses.fields(Preset)} - {"algorithm"}
    settings: dict[str, Any] = {}
    options: dict[str, Any] = {}
    for layer in layers:
        for key, value in layer.items():
            if key not in known:
                hint = name_hint(key, known, f"known: {', '.join(sorted(known))}")
                raise ValueError(f"unknown preset key {key!r}; {hint}")
            if key == "options":
                if not isinstance(value, Mapping):
                    raise ValueError(f"preset key 'options' must be a mapping, got {value!r}")
                options |= value
            else:
                settings[key] = tuple(value) if isinstance(value, list) else value
    try:
        return Preset(algorithm=algorithm, options=options, **settings)
    except TypeError as error:
        raise ValueError(f"the preset of {algorithm} is incomplete: {error}") from error


def _layers(path: Path, scenario: Scenario) -> list[dict[str, Any]]:
    """A file's default settings, and what differs in a scenario."""
    content = _read(path)
    return [content["default"], content.get("scenarios", {}).get(scenario.name, {})]


def _read(path: Path) -> dict[str, Any]:
    import yaml

    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"cannot read preset file {str(path)!r}: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{str(path)!r} is not valid YAML: {' '.join(str(error).split())}") from error
    if not isinstance(content, dict):
        raise ValueError(f"preset file {str(path)!r} must hold keys and values, got {type(content).__name__}")
    return content
