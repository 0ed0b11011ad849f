"""How fast the plant on a device is: steps per second against environments and elements, beside its memory.

A step of the batch moves its state through the device's memory, and no kernel can be faster than that:
`least_traffic` counts what a step must read and write at the least, each number once, and the roofline is
what the device copies in a second over it. How much of it is reached is the figure to improve. The same
batch on the processor, `HeaveVectorEnv` in the same precision on one thread, is measured in turns beside it.
"""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any

from heave_env.gpu.plant import GpuPlant
from heave_env.gpu.torch_env import HeaveTorchVectorEnv
from heave_env.provenance import processor, provenance
from heave_env.scenarios import load

SCENARIO = "sea_state_5"
ELEMENTS = (20, 50)
"""Elements of the cable that are measured [-]."""
BATCHES = {"cuda": (1024, 4096, 16_384, 65_536, 262_144), "cpu": (256, 4096)}
"""Environments of the batches that are measured, by kind of device [-]."""
NATIVE_BATCH = 4096
"""Most environments of the batch on the processor [-]."""
ROUNDS = 5
"""Repeats of each measurement [-]."""
ROUND_SECONDS = 0.5
"""Length of a repeat [s]."""
COPIED_BYTES = {"cuda": 2**30, "cpu": 2**27}
"""Size of the copy that measures the memory, by kind of device [bytes]."""


def least_traffic(plant: GpuPlant) -> int:
    """What a control step of one environment must read and write, each number once [bytes].

    Nodes, wave filter, channels and counters in and out; a command, the samples, the history that the
    observation is made of, and the observation.
    """
    b, numbers = plant.buffers, plant.numbers
    size = 4 if plant.dtype == "float32" else 8
    both_ways = sum(array.shape[0] for array in (b.displacement, b.velocity, b.filter, b.channels))
    history = numbers.n_lags * numbers.n_sensors + numbers.n_shown_pending
    bare = size * (2 * both_ways + 1 + numbers.n_sensors + history + 1)
    return bare + 4 * b.observation.shape[0] + 2 * (3 * 8 + 4) + 4


def copied_per_second(device: str, *, rounds: int = ROUNDS, n_bytes: int | None = None) -> float:
    """Bytes read and written in a second by a plain copy on the device, the median of its repeats."""
    import torch

    kind = "cuda" if device.startswith("cuda") else "cpu"
    n = (n_bytes or COPIED_BYTES[kind]) // 4
    source, target = torch.ones(n, device=device), torch.zeros(n, device=device)
    found = []
    for _ in range(rounds + 1):
        _wait(device)
        begin = time.perf_counter()
        target.copy_(source)
        _wait(device)
        found.append(2 * 4 * n / (time.perf_counter() - begin))
    return statistics.median(found[1:])


def _wait(device: str) -> None:
    """Waits until the device has done what it was told."""
    if device.startswith("cuda"):
        import torch

        torch.cuda.synchronize(device)


def device_name(device: str) -> str:
    """What the figures were measured on, in words."""
    if device.startswith("cuda"):
        import torch

        return str(torch.cuda.get_device_name(device))
    return f"no GPU: the processor, one thread of Warp's CPU device ({processor()})"


def _stepper(env: HeaveTorchVectorEnv, device: str) -> Callable[[float], float]:
    """Steps the batch for about so many seconds under fixed actions; returns environment steps per second."""
    import torch

    generator = torch.Generator(env.device).manual_seed(0)
    actions = [
        0.2 * torch.rand(env.num_envs, 1, device=env.device, generator=generator) - 0.1 for _ in range(8)
    ]
    env.reset(seed=0)
    for action in actions:
        env.step(action)

    def run(seconds: float) -> float:
        count = 0
        _wait(device)
        begin = time.perf_counter()
        while True:
            for action in actions:
                env.step(action)
            _wait(device)
            count += len(actions)
            spent = time.perf_counter() - begin
            if spent >= seconds:
                return count * env.num_envs / spent

    return run


def measure_gpu(
    device: str = "cuda",
    *,
    quick: bool = False,
    arguments: Sequence[str] | None = None,
    announce: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Measures the plant on a device.

    Args:
        device: "cuda", "cuda:1" and so on, or "cpu".
        quick: Whether short measurements will do, to see that all runs.
        arguments: Command line of the provenance; None: the process's own.
        announce: Called with the name of each figure before it is measured.

    Returns:
        Every figure with its share of the memory's roofline, and where it was measured.

    Raises:
        ValueError: If there is no such device.
        ModuleNotFoundError: If NVIDIA Warp is not installed.
    """
    from experiments.benchmark import batch
    from heave_env.env import HeaveVectorEnv

    say = announce or (lambda line: None)
    kind = "cuda" if device.startswith("cuda") else "cpu"
    rounds, seconds = (1, 0.02) if quick else (ROUNDS, ROUND_SECONDS)
    GpuPlant(load(SCENARIO), 1, device=device)  # refuses a device that is not there
    say("measuring the memory")
    bandwidth = copied_per_second(device, rounds=rounds, n_bytes=2**22 if quick else None)
    figures = []
    for n_elements in ELEMENTS:
        scenario = dataclasses.replace(load(SCENARIO), n_elements=n_elements)
        for num_envs in BATCHES[kind]:
            for dtype in ("float32", "float64"):
                say(f"measuring {num_envs} environments, {n_elements} elements, {dtype}")
                env = HeaveTorchVectorEnv(scenario, num_envs, device=device, dtype=dtype)
                beside_it = min(num_envs, NATIVE_BATCH)  # the processor gains nothing from more
                native = HeaveVectorEnv(scenario, beside_it, dtype=dtype, info=False, n_threads=1)
                run, run_native = _stepper(env, device), batch(native)
                own, other = [], []
                for _ in range(rounds):
                    own.append(run(seconds))
                    other.append(run_native(seconds))
                traffic = least_traffic(env.plant)
                value, beside = statistics.median(own), statistics.median(other)
                figures.append(
                    {
                        "figure": f"{num_envs} environments, {n_elements} elements, {dtype}",
                        "unit": "env steps/s",
                        "value": value,
                        "bytes_per_step": traffic,
                        "of_roofline": value * traffic / bandwidth,
                        "yardstick": f"HeaveVectorEnv of {beside_it}, one thread",
                        "yardstick_value": beside,
                        "ratio": value / beside,
                        "repeats": own,
                        "yardstick_repeats": other,
                    }
                )
                native.close()
    return {
        "kind": "gpu benchmark",
        "scenario": {"name": SCENARIO, "fingerprint": load(SCENARIO).fingerprint},
        "device": device_name(device),
        "is_gpu": kind == "cuda",
        "copied_bytes_per_second": bandwidth,
        "quick": quick,
        "figures": figures,
        "provenance": provenance(None if arguments is None else list(arguments)),
    }


def gpu_table(found: dict[str, Any]) -> list[str]:
    """The figures as lines of text."""
    lines = [
        f"Device: {found['device']}",
        f"A plain copy moves {found['copied_bytes_per_second'] / 1e9:,.1f} GB/s, read and written.",
        f"{'figure':<46}{'steps/s':>16}{'bytes/step':>12}{'of roofline':>13}{'processor':>14}{'ratio':>8}",
    ]
    for item in found["figures"]:
        lines.append(
            f"{item['figure']:<46}{item['value']:>16,.0f}{item['bytes_per_step']:>12,}"
            f"{100.0 * item['of_roofline']:>11.1f} %{item['yardstick_value']:>14,.0f}{item['ratio']:>8.2f}"
        )
    made = found["provenance"]
    packages = ", ".join(f"{name} {version}" for name, version in made["versions"].items())
    return [*lines, f"{made['date']}, processor {made['processor']}; commit {made['commit']}", packages]
