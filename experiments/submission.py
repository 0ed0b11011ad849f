"""Controllers of others, from a Python file that is named on the command line.

The file holds an object `controller` with `predict`, or a function (or class) `controller(scenario)` that
makes one. Loading it runs its code, as importing it would.
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from heave_env.controller import shown_to
from heave_env.scenarios import Scenario

Array = np.ndarray

NAME = "controller"
"""What the file must define."""


class Submission:
    """A controller from a file, whose every answer is checked."""

    def __init__(self, path: str, inner: Any) -> None:
        """Takes the file's path and what acts."""
        self.path, self.inner = path, inner
        self.name = str(getattr(inner, "name", Path(path).stem))
        self.information_set: str | None = getattr(inner, "information_set", None)
        self.history_lags: tuple[int, ...] | None = getattr(inner, "history_lags", None)
        self.measures: tuple[str, ...] = tuple(getattr(inner, "measures", ()))

    def predict(
        self,
        observation: Array,
        state: Any | None = None,
        episode_start: Array | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Any | None]:
        """Returns its actions, (n_envs, 1), and its memory.

        Raises:
            ValueError: If it raises, or returns something else.
        """
        try:
            answer = self.inner.predict(
                observation, state=state, episode_start=episode_start, deterministic=deterministic
            )
        except Exception as error:
            raise _refused(self.path, f"predict failed with {_said(error)}") from error
        if not isinstance(answer, tuple) or len(answer) != 2:
            raise _refused(self.path, f"predict must return (action, state), got {type(answer).__name__}")
        wanted = (*np.shape(observation)[:-1], 1)
        try:
            action = np.asarray(answer[0], dtype=float)
        except (TypeError, ValueError) as error:
            raise _refused(self.path, "predict must return numbers for actions") from error
        if action.shape != wanted:
            raise _refused(self.path, f"predict must return actions of shape {wanted}, got {action.shape}")
        if not np.isfinite(action).all():
            raise _refused(self.path, "predict returned an action that is not finite; actions lie in [-1, 1]")
        return action, answer[1]


def load_submission(path: str, scenario: Scenario) -> Submission:
    """The controller of a Python file for a scenario, tried on one decision.

    Args:
        path: The file.
        scenario: The operation; of a variant, the file is given what it is nominally.

    Raises:
        ValueError: If there is no such file, it fails, or what it holds is no controller.
    """
    held = getattr(_module(path), NAME, None)
    if held is None:
        raise _refused(path, f"it defines no {NAME}: an object with predict, or a function of the scenario")
    inner = held
    if isinstance(held, type) or not hasattr(held, "predict"):
        if not callable(held):
            raise _refused(path, f"its {NAME} is {type(held).__name__}, which has no predict")
        try:
            inner = held(scenario.design_basis)
        except Exception as error:
            raise _refused(path, f"{NAME}({scenario.name}) failed with {_said(error)}") from error
    if not callable(getattr(inner, "predict", None)):
        raise _refused(path, f"its {NAME} makes {type(inner).__name__}, which has no predict")
    made = Submission(path, inner)
    _try(made, scenario)
    return made


def _module(path: str) -> ModuleType:
    file = Path(path).resolve()
    if not file.is_file():
        raise ValueError(f"there is no submission {path!r}; name a Python file")
    spec = importlib.util.spec_from_file_location(f"submission_{file.stem}", file)
    if file.suffix != ".py" or spec is None or spec.loader is None:
        raise _refused(path, "it must be a Python file, *.py")
    module, known = importlib.util.module_from_spec(spec), set(sys.modules)
    sys.modules[spec.name] = module  # dataclasses look their own module up
    sys.path.insert(0, str(file.parent))
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise _refused(path, f"it cannot be loaded: {_said(error)}") from error
    finally:
        sys.path.remove(str(file.parent))
        # Another's file may import a neighbour of the same name.
        for name in set(sys.modules) - known - {spec.name}:
            origin = getattr(sys.modules[name], "__file__", None)
            if origin is not None and Path(origin).parent == file.parent:
                del sys.modules[name]
    return module


def _try(made: Submission, scenario: Scenario) -> None:
    """Lets it decide once, so that what is wrong with it shows before any hour of work."""
    from heave_env.env import HeaveVectorEnv

    try:
        env = HeaveVectorEnv(shown_to(made, scenario), num_envs=2)
    except ValueError as error:
        raise _refused(made.path, str(error)) from error
    try:
        observation, _ = env.reset(seed=[0, 1])
        made.predict(observation, episode_start=np.ones(2, dtype=bool))
    finally:
        env.close()


def _said(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def _refused(path: str, reason: str) -> ValueError:
    return ValueError(f"submission {path!r}: {reason}")
