"""The state of a training on disk, and back: arrays in safetensors, numbers in JSON, no pickle.

`save_state` writes the arrays first, under a new name, and then the JSON that names them with their
hash. Until the JSON is renamed into place the previous state stands whole, so that a kill at any
moment leaves one complete state.
"""

from __future__ import annotations

import json
import random
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.numpy import load as load_tensors
from safetensors.numpy import save as save_tensors
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from agents.policy import canonical, sha256
from heave_env.files import write_atomic

STATE_FORMAT = "heave_env training state 1"
"""What a training state's JSON says it is."""
STATE_FILE = "state.json"
"""The JSON's name in the folder of the training state."""

Arrays = dict[str, np.ndarray]


def save_state(folder: Path, arrays: Mapping[str, np.ndarray], content: Mapping[str, Any], step: int) -> None:
    """Writes a training state; the one before it stands until this one is whole.

    Args:
        folder: Where to write; made if missing.
        arrays: Everything that is an array.
        content: Everything else, as JSON values.
        step: Environment steps so far, for the file's name.
    """
    folder.mkdir(parents=True, exist_ok=True)
    previous = {path.name for path in folder.glob("arrays-*.safetensors")}
    packed = save_tensors({name: np.asarray(value, order="C") for name, value in arrays.items()})
    name = f"arrays-{step}.safetensors"
    if name in previous:  # written twice at one step: the standing JSON may name this very file
        name = f"arrays-{step}-again.safetensors"
        if name in previous:
            name = f"arrays-{step}.safetensors"
    write_atomic(folder / name, packed)
    body = {
        "format": STATE_FORMAT,
        "step": step,
        "arrays": name,
        "arrays_sha256": sha256(packed),
        "content": dict(content),
    }
    whole = {**body, "sha256": sha256(canonical(body))}
    write_atomic(folder / STATE_FILE, (json.dumps(whole) + "\n").encode())
    for old in previous - {name}:
        (folder / old).unlink(missing_ok=True)


def has_state(folder: Path) -> bool:
    """Whether a training state has been written to the folder."""
    return (folder / STATE_FILE).exists()


def load_state(folder: Path) -> tuple[Arrays, dict[str, Any]]:
    """Reads a training state back, verified.

    Returns:
        The arrays and the content that `save_state` was given.

    Raises:
        ValueError: If a file is missing, cut short or changed.
    """
    path = folder / STATE_FILE
    remedy = f"delete the folder {str(folder)!r} to train from the beginning"
    try:
        body = json.loads(path.read_text(encoding="utf-8"))
        stated = body.pop("sha256")
        if body["format"] != STATE_FORMAT or stated != sha256(canonical(body)):
            raise ValueError("its hash or format is not the stated one")
        packed = (folder / Path(body["arrays"]).name).read_bytes()
        if sha256(packed) != body["arrays_sha256"]:
            raise ValueError(f"{body['arrays']} does not have the stated hash")
        return load_tensors(packed), body["content"]
    except (OSError, KeyError, AttributeError, TypeError, ValueError, SafetensorError) as error:
        raise ValueError(
            f"training state {str(path)!r} is cut short or changed ({error}); {remedy}"
        ) from error


def under(arrays: Arrays, prefix: str) -> Arrays:
    """The arrays whose names begin with a prefix, which is taken off."""
    return {name.removeprefix(prefix): value for name, value in arrays.items() if name.startswith(prefix)}


# The algorithm -----------------------------------------------------------------------------------


def optimizers_of(model: BaseAlgorithm) -> dict[str, torch.optim.Optimizer]:
    """The optimisers of an algorithm by name."""
    found: dict[str, torch.optim.Optimizer] = {}
    for owner in ("policy", "actor", "critic"):
        optimizer = getattr(getattr(model, owner, None), "optimizer", None)
        if isinstance(optimizer, torch.optim.Optimizer):
            found[owner] = optimizer
    temperature = getattr(model, "ent_coef_optimizer", None)
    if isinstance(temperature, torch.optim.Optimizer):
        found["temperature"] = temperature
    return found


def model_state(model: BaseAlgorithm) -> tuple[Arrays, dict[str, Any]]:
    """Everything an algorithm needs to go on bit-identically, but for its environment.

    Weights, optimisers, replay buffer, last observation, an LSTM's memory, counters and the global random
    streams of torch, NumPy, Python and the action space.
    """
    arrays: Arrays = {}
    for name, tensor in model.policy.state_dict().items():
        arrays[f"policy/{name}"] = tensor.detach().cpu().numpy()
    content: dict[str, Any] = {"optimizers": {}, "counters": {}}
    for owner, optimizer in optimizers_of(model).items():
        state = optimizer.state_dict()
        content["optimizers"][owner] = state["param_groups"]
        for index, slots in state["state"].items():
            for slot, value in slots.items():
                arrays[f"optimizer/{owner}/{index}/{slot}"] = torch.as_tensor(value).cpu().numpy()
    log_ent_coef = getattr(model, "log_ent_coef", None)
    if log_ent_coef is not None:
        arrays["log_ent_coef"] = log_ent_coef.detach().cpu().numpy()
    assert isinstance(model._last_obs, np.ndarray)
    arrays["last_obs"] = model._last_obs
    arrays["last_episode_starts"] = np.asarray(model._last_episode_starts)
    for owner, part, tensor in _memories(model):
        arrays[f"memory/{owner}/{part}"] = tensor.cpu().numpy()
    for counter in _COUNTERS:
        content["counters"][counter] = getattr(model, counter)
    if isinstance(model, OffPolicyAlgorithm):
        arrays |= _buffer_arrays(model)
        content["buffer"] = {"pos": model.replay_buffer.pos, "full": model.replay_buffer.full}  # type: ignore[union-attr]
    random_arrays, content["random"] = _random_state(model)
    return arrays | random_arrays, content


def restore_model(model: BaseAlgorithm, arrays: Arrays, content: Mapping[str, Any]) -> None:
    """Puts an algorithm, built as it was, into the state that `model_state` gave."""
    weights = {name: torch.as_tensor(value) for name, value in under(arrays, "policy/").items()}
    model.policy.load_state_dict(weights)
    for owner, optimizer in optimizers_of(model).items():
        state: dict[int, dict[str, torch.Tensor]] = {}
        for name, value in under(arrays, f"optimizer/{owner}/").items():
            index, slot = name.split("/")
            state.setdefault(int(index), {})[slot] = torch.as_tensor(value)
        optimizer.load_state_dict({"state": state, "param_groups": content["optimizers"][owner]})
    if "log_ent_coef" in arrays:
        with torch.no_grad():
            model.log_ent_coef.copy_(torch.as_tensor(arrays["log_ent_coef"]))  # type: ignore[attr-defined]
    model._last_obs = np.array(arrays["last_obs"])
    model._last_episode_starts = np.array(arrays["last_episode_starts"])
    for owner, part, tensor in _memories(model):
        tensor.copy_(torch.as_tensor(arrays[f"memory/{owner}/{part}"]))
    for counter, value in content["counters"].items():
        setattr(model, counter, value)
    if isinstance(model, OffPolicyAlgorithm):
        buffer = model.replay_buffer
        assert buffer is not None
        for name, value in under(arrays, "buffer/").items():
            getattr(buffer, name)[: len(value)] = value
        buffer.pos, buffer.full = content["buffer"]["pos"], content["buffer"]["full"]
    _restore_random_state(model, arrays, content["random"])


def _memories(model: BaseAlgorithm) -> Iterator[tuple[str, str, torch.Tensor]]:
    """What the LSTMs of actor and critic remember of each row, by owner and part."""
    states = getattr(model, "_last_lstm_states", None)
    for owner in ("pi", "vf") if states is not None else ():
        for part, tensor in zip(("output", "cell"), getattr(states, owner), strict=True):
            yield owner, part, tensor


_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_current_progress_remaining")
_BUFFER = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def _buffer_arrays(model: OffPolicyAlgorithm) -> Arrays:
    buffer = model.replay_buffer
    assert buffer is not None
    filled = buffer.buffer_size if buffer.full else buffer.pos
    return {f"buffer/{name}": getattr(buffer, name)[:filled] for name in _BUFFER}


def _random_state(model: BaseAlgorithm) -> tuple[Arrays, dict[str, Any]]:
    kind, keys, pos, has_gauss, cached = np.random.get_state(legacy=True)  # noqa: NPY002 (SB3 draws from it)
    version, internal, gauss = random.getstate()
    arrays = {
        "random/torch": torch.get_rng_state().numpy(),
        "random/numpy": np.asarray(keys),
        "random/python": np.array(internal, dtype=np.uint64),
    }
    space = model.action_space.np_random.bit_generator.state
    content = {
        "numpy": [str(kind), int(pos), int(has_gauss), float(cached)],
        "python": [version, gauss],
        "action_space": space,
    }
    return arrays, content


def _restore_random_state(model: BaseAlgorithm, arrays: Arrays, content: Mapping[str, Any]) -> None:
    torch.set_rng_state(torch.as_tensor(arrays["random/torch"]))
    kind, pos, has_gauss, cached = content["numpy"]
    np.random.set_state((kind, arrays["random/numpy"], pos, has_gauss, cached))  # noqa: NPY002 (SB3 draws from it)
    version, gauss = content["python"]
    random.setstate((version, tuple(int(word) for word in arrays["random/python"]), gauss))
    model.action_space.np_random.bit_generator.state = content["action_space"]
