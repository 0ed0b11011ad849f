"""A trained policy on disk, and as a controller through plain NumPy.

A saved policy is two files: weights in safetensors and a JSON that says what they are (architecture,
observation, scenario, training). The JSON holds the hash of the weights' file, and that file's own
header the hash of the JSON's content, so that neither can be changed alone. Loading executes no code and
does not need torch.
"""

from __future__ import annotations

import copy
import dataclasses
import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load as load_tensors
from safetensors.numpy import save as save_tensors

from agents.guide import Guide, guide_from_card
from heave_env.files import write_atomic
from heave_env.scenarios import Scenario, from_mapping, to_mapping

POLICY_FORMAT = "heave_env policy 1"
"""What a policy's JSON says it is."""
POLICY_FILE = "policy.json"
"""The JSON's name in a run folder; the weights lie beside it under the same stem."""

WHITENING = "features.weight"
"""Name of the matrix that makes features of observations; its rows cancel what nearly goes together."""

ACTIVATIONS: dict[str, Callable[[Any], Any]] = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, np.float32(0.0)),
}
"""Activations between the layers, by name."""
OUTPUTS: dict[str, Callable[[Any], Any]] = {"clip": lambda x: np.clip(x, -1.0, 1.0), "tanh": np.tanh}
"""How the last layer becomes an action, by name."""


def sha256(content: bytes) -> str:
    """Hash of a file's content, hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def canonical(content: Mapping[str, Any]) -> bytes:
    """JSON in one spelling, for hashing."""
    return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()


@dataclass(frozen=True)
class Architecture:
    """Layers of a saved policy.

    Features are a matrix times the observation, cut off at a bound; hidden layers follow; the linear layer
    at the end sees the last hidden layer and the features beside it. With a memory, the output of an LSTM
    that the features go through stands before the features, wherever they are seen.

    Source: Hochreiter and Schmidhuber (1997), the LSTM, with the forget gate of Gers et al. (2000).
    """

    n_observations: int
    """Entries of the observation [-]."""
    feature_bound: float
    """Features are cut off at ± this [-]."""
    hidden: tuple[int, ...]
    """Widths of the hidden layers [-]."""
    activation: str
    """One of `ACTIVATIONS`."""
    output: str
    """One of `OUTPUTS`."""
    memory: int = 0
    """Width of the LSTM [-]; 0: the policy remembers nothing."""

    def __post_init__(self) -> None:
        if not self.hidden or not self.feature_bound > 0.0:
            raise ValueError("Architecture wants at least one hidden layer and a positive feature_bound")
        if not isinstance(self.memory, int) or self.memory < 0:
            raise ValueError(f"Architecture.memory must be a whole number from 0, got {self.memory!r}")
        for name, known in (("activation", ACTIVATIONS), ("output", OUTPUTS)):
            if getattr(self, name) not in known:
                raise ValueError(
                    f"Architecture.{name} must be one of {', '.join(known)}, got {getattr(self, name)!r}"
                )

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The weights by name, with their shapes."""
        n, size = self.n_observations, self.memory
        shapes: dict[str, tuple[int, ...]] = {"features.weight": (n, n)}
        if size:
            shapes["memory.weight"], shapes["memory.recurrent_weight"] = (4 * size, n), (4 * size, size)
            shapes["memory.bias"] = (4 * size,)
        seen = width = size + n
        for i, size in enumerate(self.hidden):
            shapes[f"hidden.{i}.weight"], shapes[f"hidden.{i}.bias"] = (size, width), (size,)
            width = size
        shapes["output.weight"], shapes["output.bias"] = (1, width + seen), (1,)
        return shapes


class TrainedPolicy:
    """A trained agent as a `Controller`: deterministic, in float32.

    Its memory is its guide's, if it has one, and behind that its LSTM's output and cell, if it has one.
    """

    def __init__(
        self, architecture: Architecture, weights: Mapping[str, np.ndarray], card: Mapping[str, Any]
    ) -> None:
        """Takes the layers and what is known of them.

        Args:
            architecture: Sizes and kinds of the layers.
            weights: Arrays by the names and in the shapes of `architecture.shapes`.
            card: The rest of the policy's JSON: algorithm, scenario, observation names, training.

        Raises:
            ValueError: If a weight is missing, unknown, misshapen or not finite.
        """
        shapes = architecture.shapes
        if set(weights) != set(shapes):
            odd = sorted(set(weights) ^ set(shapes))
            raise ValueError(f"the policy's weights do not fit its architecture: {', '.join(odd)}")
        for name, shape in shapes.items():
            if weights[name].shape != shape:
                raise ValueError(
                    f"the policy's weight {name} must have shape {shape}, got {weights[name].shape}"
                )
            if not np.all(np.isfinite(weights[name])):
                raise ValueError(
                    f"the policy's weight {name} holds numbers that are not finite; train it again"
                )
        self.architecture = architecture
        self.weights = {name: np.asarray(weights[name], dtype=np.float32) for name in shapes}
        self.card = dict(card)
        self.scenario: Scenario = from_mapping(self.card["scenario"])
        """The scenario it was trained in, with the information set it sees."""
        self.name: str = str(self.card["algorithm"])
        self.information_set: str = self.scenario.information_set
        self.history_lags: tuple[int, ...] | None = None
        """Ages of the samples that it sees, if it sees a history [control steps]."""
        if self.information_set == "sensors_history":
            self.history_lags = self.scenario.history_lags
        self.measures: tuple[str, ...] = tuple(sensor.channel for sensor in self.scenario.observed_sensors)
        self.guide: Guide | None = None
        """The designed controller beside it."""
        if self.card.get("guide"):
            self.guide = guide_from_card(self.card["guide"], self.scenario)
        n = architecture.n_observations - (0 if self.guide is None else len(self.guide.feature_names))
        self._n_observed = n
        self._gain, self._shift = np.ones(n, dtype=np.float32), np.zeros(n, dtype=np.float32)
        self._action_gain = np.float32(1.0)

    def predict(
        self,
        observation: np.ndarray,
        state: Any | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any | None]:
        """Returns actions in [-1, 1], shape `(n_envs, 1)`, or `(1,)` for one observation, and the memory.

        Args:
            observation: (n_envs, n_observations), or (n_observations,) of a single environment.
            state: The memory as last returned, (n_envs, n_memory); None begins afresh.
            episode_start: Rows that begin afresh, (n_envs,).
            deterministic: Without effect.

        Raises:
            ValueError: If the observation has another number of entries than the policy was trained on.
        """
        x = np.asarray(observation, dtype=np.float32)
        n = self._n_observed
        if x.ndim not in (1, 2) or x.shape[-1] != n:
            raise ValueError(
                f"this policy wants {n} observations per row ({self.information_set}), got shape {x.shape}: "
                f"build the environment with information_set={self.information_set!r}"
            )
        x = x * self._gain + self._shift
        if not self.n_memory:
            return np.clip(self.act(x) * self._action_gain, -1.0, 1.0).astype(np.float32), None
        rows = np.atleast_2d(x)
        memory = np.zeros((len(rows), self.n_memory)) if state is None else np.asarray(state)
        if episode_start is not None:
            memory = np.where(np.asarray(episode_start, dtype=bool).reshape(-1, 1), 0.0, memory)
        if self.guide is None:
            share, memory = self.respond(rows, memory)
        else:
            told, own = np.split(memory, [self.guide.n_memory], axis=1)
            look = self.guide.look(rows, told)
            given, own = self.respond(np.hstack([rows, look.features]), own)
            command = self.guide.command(look, given)
            share = command / self.guide.controller.command_range
            memory = np.hstack([self.guide.advance(told, look, command), own])
        action = np.clip(share * float(self._action_gain), -1.0, 1.0).astype(np.float32)
        return (action[0] if x.ndim == 1 else action), memory

    @property
    def n_memory(self) -> int:
        """Numbers that it remembers of each row [-]."""
        return 2 * self.architecture.memory + (0 if self.guide is None else self.guide.n_memory)

    def act(self, seen: np.ndarray) -> np.ndarray:
        """The network's own action in [-1, 1], (..., 1): what it was trained to give for what it saw.

        An LSTM is afresh.
        """
        return self.respond(seen, np.zeros((*seen.shape[:-1], 2 * self.architecture.memory)))[0]

    def respond(self, seen: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The network's own action in [-1, 1], (..., 1), and the LSTM's next memory.

        Args:
            seen: What it was trained to see, (..., n).
            memory: The LSTM's output and cell as last returned, (..., 2 * width); zeros to begin with.
        """
        weights, size = self.weights, self.architecture.memory
        activation = ACTIVATIONS[self.architecture.activation]
        bound = np.float32(self.architecture.feature_bound)
        features = np.clip(seen @ weights["features.weight"].T, -bound, bound)
        if size:
            last = np.asarray(memory, dtype=np.float32)
            gates = (
                features @ weights["memory.weight"].T
                + last[..., :size] @ weights["memory.recurrent_weight"].T
            )
            entry, keep, fresh, out = np.split(gates + weights["memory.bias"], 4, axis=-1)
            cell = _sigmoid(keep) * last[..., size:] + _sigmoid(entry) * np.tanh(fresh)
            output = _sigmoid(out) * np.tanh(cell)
            memory = np.concatenate([output, cell], axis=-1)
            features = np.concatenate([output, features], axis=-1)
        latent = features
        for i in range(len(self.architecture.hidden)):
            latent = activation(latent @ weights[f"hidden.{i}.weight"].T + weights[f"hidden.{i}.bias"])
        latent = np.concatenate([latent, features], axis=-1)
        mean = latent @ weights["output.weight"].T + weights["output.bias"]
        return np.asarray(OUTPUTS[self.architecture.output](mean)), memory

    def acting_in(self, scenario: Scenario) -> TrainedPolicy:
        """The policy reading another scenario's observations and commanding its winch, in SI the same.

        Sensors' scales and offsets and the command range may differ between scenarios; the layout of the
        observation may not.

        Raises:
            ValueError: If the observations are laid out otherwise.
        """
        seen, own = seen_by(self, scenario), self.scenario
        if seen.observation_names != own.observation_names:
            raise ValueError(
                f"a policy trained in scenario {own.name!r} cannot act in {scenario.name!r}: "
                "other things are observed there"
            )
        adapted = copy.copy(self)
        ratio = seen.winch.command_range / own.winch.command_range
        gain, shift = [], []
        for there, here in zip(seen.observed_sensors, own.observed_sensors, strict=True):
            there_scale, here_scale = float(there.scale or 1.0), float(here.scale or 1.0)
            gain.append(there_scale / here_scale)
            shift.append((there.offset - here.offset) / here_scale)
        n_lags, n_pending = len(own.observed_lags), own.n_shown_pending
        n_filter = own.observed_filter_states + len(own.observed_draws)
        adapted._gain = np.array(gain * n_lags + [1.0] * n_filter + [ratio] * n_pending, dtype=np.float32)
        adapted._shift = np.array(shift * n_lags + [0.0] * (n_filter + n_pending), dtype=np.float32)
        adapted._action_gain = np.float32(1.0 / ratio)
        return adapted


def _sigmoid(x: np.ndarray) -> np.ndarray:
    """1 / (1 + exp(-x)), without overflow."""
    return np.float32(0.5) * (np.tanh(np.float32(0.5) * x) + np.float32(1.0))


def save_policy(path: Path, policy: TrainedPolicy) -> None:
    """Writes a policy's JSON to `path` and its weights beside it, each whole or not at all.

    Args:
        path: The JSON's path, as `run/policy.json`.
        policy: What to write.
    """
    told, weights = packed(policy, path.with_suffix(".safetensors").name)
    write_atomic(path.with_suffix(".safetensors"), weights)
    write_atomic(path, told)


def packed(
    policy: TrainedPolicy, weights_file: str, dtype: type[np.floating[Any]] = np.float32
) -> tuple[bytes, bytes]:
    """A policy's JSON and its weights, as the content of two files.

    Args:
        policy: What to write.
        weights_file: Name of the weights' file, which the JSON states.
        dtype: Precision that the weights are rounded to in their file, but for the matrix that makes features
            of what is seen: it takes large numbers from each other. A policy acts in float32 always.

    Raises:
        ValueError: If a weight is too large for that precision.
    """
    layers = dataclasses.asdict(policy.architecture)
    if not layers["memory"]:  # the file of a policy that remembers nothing stays as it was
        del layers["memory"]
    content = {"format": POLICY_FORMAT, **policy.card, "architecture": layers, "weights": weights_file}
    content = json.loads(canonical(content))
    tensors = {}
    for name, value in policy.weights.items():
        kept = np.float32 if name == WHITENING else dtype
        most = float(np.abs(value).max(initial=0.0))
        if most > float(np.finfo(kept).max):
            raise ValueError(f"the policy's weight {name} reaches {most:g}, too much for {kept.__name__}")
        tensors[name] = np.ascontiguousarray(value, dtype=kept)
    weights = save_tensors(tensors, metadata={"content_sha256": sha256(canonical(content))})
    content["weights_sha256"] = sha256(weights)
    return (json.dumps(content, indent=1) + "\n").encode(), weights


def load_policy(
    path: str | Path, scenario: Scenario | None = None, *, allow_other_scenario: bool = False
) -> TrainedPolicy:
    """Loads a saved policy as a controller, without executing code and without torch.

    Args:
        path: A run folder, or a policy's JSON or safetensors file.
        scenario: The scenario it is to act in; None to take the one it was trained in.
        allow_other_scenario: Whether another scenario will do if its observations are laid out alike.

    Returns:
        The policy; `information_set` says what the environment must show it.

    Raises:
        ValueError: If files are missing, cut short or changed, or the policy belongs to another scenario.
    """
    path = Path(path)
    path = path / POLICY_FILE if path.is_dir() else path.with_suffix(".json")
    content = _read_content(path)
    weights = _read_weights(path, content)
    try:
        layers = dict(content["architecture"])
        architecture = Architecture(**{**layers, "hidden": tuple(layers["hidden"])})
        outer = ("format", "architecture", "weights", "weights_sha256")
        policy = TrainedPolicy(
            architecture, weights, {key: value for key, value in content.items() if key not in outer}
        )
    except (KeyError, TypeError) as error:
        raise ValueError(
            f"policy {str(path)!r} lacks or misnames {error}; it is of another format"
        ) from error
    # On a variant of the scenario that it was trained in the policy sees and commands the same.
    if scenario is None or any(
        _same_operation(seen_by(policy, known), policy.scenario)
        for known in (scenario.design_basis, scenario)
    ):
        return policy
    if not allow_other_scenario:
        raise ValueError(
            f"policy {str(path)!r} was trained in scenario {policy.scenario.name!r} (fingerprint "
            f"{policy.scenario.fingerprint}), not in this {scenario.name!r} (fingerprint "
            f"{seen_by(policy, scenario).fingerprint}): train one for it, or allow another scenario"
        )
    return policy.acting_in(scenario)


def seen_by(policy: TrainedPolicy, scenario: Scenario) -> Scenario:
    """A scenario with the information set and history lags that a policy sees."""
    return dataclasses.replace(
        scenario,
        information_set=policy.scenario.information_set,
        history_lags=policy.scenario.history_lags,
    )


def _same_operation(one: Scenario, other: Scenario) -> bool:
    """Whether two scenarios differ at most in name and in the length of their episodes."""
    mappings = [to_mapping(scenario) for scenario in (one, other)]
    for mapping in mappings:
        for label in ("name", "description", "tags", "duration"):
            mapping.pop(label)
    return mappings[0] == mappings[1]


def _read_content(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(
            f"there is no trained policy at {str(path)!r}: name a run folder that `heave train` has written"
        ) from error
    except ValueError as error:
        raise ValueError(
            f"policy {str(path)!r} is cut short or damaged: {error}; restore or retrain it"
        ) from error
    if not isinstance(content, dict) or content.get("format") != POLICY_FORMAT:
        raise ValueError(f"{str(path)!r} is not a policy of the format {POLICY_FORMAT!r}; train it again")
    return content


def _read_weights(path: Path, content: dict[str, Any]) -> dict[str, np.ndarray]:
    name = content.get("weights")
    if not isinstance(name, str) or Path(name).name != name:
        raise ValueError(f"policy {str(path)!r} must name a weights file beside it, got {name!r}")
    weights_file = path.with_name(name)
    try:
        packed = weights_file.read_bytes()
    except OSError as error:
        raise ValueError(
            f"policy {str(path)!r} lacks its weights file {name!r}; restore or retrain it"
        ) from error
    if sha256(packed) != content.get("weights_sha256"):
        raise ValueError(
            f"weights {str(weights_file)!r} do not have the hash that {path.name} states: they are cut short "
            "or changed; restore or retrain them"
        )
    try:
        weights = load_tensors(packed)
    except SafetensorError as error:
        raise ValueError(f"weights {str(weights_file)!r} are no safetensors file: {error}") from error
    header_size = int.from_bytes(packed[:8], "little")
    header = json.loads(packed[8 : 8 + header_size])
    stated = header.get("__metadata__", {}).get("content_sha256")
    bare = {key: value for key, value in content.items() if key != "weights_sha256"}
    if stated != sha256(canonical(bare)):
        raise ValueError(f"policy {str(path)!r} was changed after training; restore or retrain it")
    return weights


def policy_card(scenario: Scenario, **facts: Any) -> dict[str, Any]:
    """What a policy's JSON says beside the layers: scenario, observation, and the facts given."""
    return {
        **facts,
        "scenario_name": scenario.name,
        "fingerprint": scenario.fingerprint,
        "information_set": scenario.information_set,
        "observation_names": list(scenario.observation_names),
        "scenario": to_mapping(scenario),
    }
