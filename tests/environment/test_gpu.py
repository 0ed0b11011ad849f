"""The GPU's plant is the processor's: same seas, same noise, same motion, within rounding.

Runs on Warp's processor device, and on a CUDA card where there is one.
"""

import dataclasses
import sys

import numpy as np
import pytest

from heave_env.document import with_values
from heave_env.env import HeaveEnv, HeaveVectorEnv
from heave_env.layout import CHANNEL_NAMES
from heave_env.plant import Plant
from heave_env.scenarios import load
from heave_env.sensors import Sensor

wp = pytest.importorskip("warp")
torch = pytest.importorskip("torch")

from heave_env.gpu.kernel import kernels, warp  # noqa: E402
from heave_env.gpu.plant import GpuPlant, form_of  # noqa: E402
from heave_env.gpu.torch_env import HeaveTorchVectorEnv  # noqa: E402

DEVICES = ["cpu", *(["cuda"] if warp().is_cuda_available() else [])]
on_each_device = pytest.mark.parametrize("device", DEVICES)

DRIVES = {
    "second_order_drive": {
        "winch.time_constant": None,
        "winch.natural_omega": 3.0,
        "winch.power_limit": 2e4,
        "task.energy_weight": 5.0,
    },
    "torque_limited_drive": {
        "winch.torque_limit": 1.2e5,
        "winch.drum_radius": 1.0,
        "winch.drum_inertia": 2e4,
        "winch.dead_band": 0.002,
        "winch.command_step": 0.001,
    },
}


def both(scenario, n_envs, *, device, dtype="float64", seed=5, n_steps=None):
    """The same batch on the processor and on a device, begun."""
    one = Plant(scenario, n_envs, dtype=dtype, n_steps=n_steps)
    other = GpuPlant(scenario, n_envs, device=device, dtype=dtype, n_steps=n_steps)
    for plant in (one, other):
        plant.begin(np.ones(n_envs, dtype=bool), seed + np.arange(n_envs))
    return one, other


def compensating(plant, share=0.8):
    """What following the boom tip would command; single precision, which both plants are given."""
    command = -share * plant.channel("boom_tip_heave") / plant.scenario.winch.command_range
    return command.astype(np.float32)


def step_both(one, other, actions):
    one.advance(actions.astype(np.float64))
    other.advance(wp.array(actions, dtype=wp.float32, device=other.device))


class Difference:
    """Largest difference of each channel, relative to that channel's own largest size."""

    def __init__(self):
        self.largest, self.size = np.zeros(len(CHANNEL_NAMES)), np.zeros(len(CHANNEL_NAMES))

    def take(self, one, other):
        expected, found = one.channels.T, other.numpy("channels")
        finite = np.isfinite(expected)
        assert np.array_equal(expected[~finite], found[~finite])
        size = np.where(finite, np.abs(expected), 0.0)
        apart = np.abs(np.where(finite, found, 0.0) - np.where(finite, expected, 0.0))
        self.size = np.maximum(self.size, size.max(axis=1))
        self.largest = np.maximum(self.largest, apart.max(axis=1))

    @property
    def relative(self):
        return float(np.max(self.largest / np.maximum(self.size, 1e-300)))


@on_each_device
@pytest.mark.parametrize(
    "name", ["thesis_linear", "limits_linear", "sea_state_5", "lowering", "snap", "deep_resonance", *DRIVES]
)
def test_the_device_agrees_with_the_processor_over_1000_steps(name, device):
    scenario = with_values(load("sea_state_5"), DRIVES[name]) if name in DRIVES else load(name)
    one, other = both(scenario, 3, device=device)
    assert np.array_equal(one.observation, other.numpy("observation").T)
    difference, rewards, observations = Difference(), 0.0, 0.0
    for _ in range(1000):
        step_both(one, other, compensating(one))
        difference.take(one, other)
        assert np.array_equal(one.outcome, other.numpy("outcome"))
        observations = max(observations, np.max(np.abs(one.observation - other.numpy("observation").T)))
        rewards = max(rewards, np.max(np.abs(other.numpy("reward") / one.reward - 1.0)))
    print(f"{name} on {device}: channels agree to {difference.relative:.1e}, rewards to {rewards:.1e}")
    assert difference.relative < 1e-9
    assert rewards < 1e-6  # relative to each, however small
    assert observations < 2e-6  # of numbers up to 50 in single precision
    assert np.array_equal(one.steps(), other.steps())


@pytest.mark.slow
@on_each_device
@pytest.mark.parametrize(
    "name", ["thesis_regulator_delay", "thesis_cable", "landing", "energy_linear", "limits_unknown_linear"]
)
def test_the_other_named_scenarios_agree_too(name, device):
    one, other = both(load(name), 3, device=device)
    difference = Difference()
    for _ in range(1000):
        step_both(one, other, compensating(one))
        difference.take(one, other)
    print(f"{name} on {device}: channels agree to {difference.relative:.1e}")
    assert difference.relative < 1e-9
    assert np.allclose(one.observation, other.numpy("observation").T, rtol=0, atol=2e-6)


@on_each_device
def test_each_step_agrees_where_slack_makes_the_motion_chaotic(device):
    # Under rough commands a difference in the last bits grows by itself: compare from a common state.
    scenario, n = load("lowering"), 20
    one, other = both(scenario, n, device=device)
    nearly = Plant(scenario, n)
    nearly.begin(np.ones(n, dtype=bool), 5 + np.arange(n))
    rng = np.random.default_rng(0)
    actions, worst, slack, grown = np.zeros(n), 0.0, 0.0, 0.0
    for step in range(300):
        actions = np.clip(0.95 * actions + 0.1 * rng.standard_normal(n), -1.2, 1.2).astype(np.float32)
        other.take_from(one)
        step_both(one, other, actions)
        nearly.advance(actions.astype(np.float64) * (1.0 + 1e-15))
        if step < 100:
            apart = nearly.channel("sheave_tension") - one.channel("sheave_tension")
            grown = max(grown, np.max(np.abs(apart)) / scenario.static_tension)
        difference = Difference()
        difference.take(one, other)
        worst = max(worst, difference.relative)
        slack += one.channel("slack").sum()
    print(
        f"lowering under rough commands on {device}: a step agrees to {worst:.1e}, {slack:.0f} slack steps;"
    )
    print(
        f"on the processor alone 1e-15 of the actions grows to {grown:.0e} of the static tension within 10 s"
    )
    assert slack > 100
    assert grown > 1e-7
    assert worst < 1e-9


@on_each_device
@pytest.mark.parametrize("name", ["sea_state_5", "deep_resonance"])
def test_single_precision_is_far_within_the_error_of_the_time_step(name, device):
    scenario = load(name)
    n = 4
    plants = [
        Plant(scenario, n),
        Plant(dataclasses.replace(scenario, n_substeps=2 * scenario.n_substeps), n),
        GpuPlant(scenario, n, device=device, dtype="float32"),
    ]
    for plant in plants:
        plant.begin(np.ones(n, dtype=bool), np.arange(n))
    heave = []
    for _ in range(1000):
        actions = compensating(plants[0])
        for plant in plants[:2]:
            plant.advance(actions.astype(np.float64))
        plants[2].advance(wp.array(actions, dtype=wp.float32, device=plants[2].device))
        heave.append([plant.channel("payload_heave") for plant in plants])
    double, finer, single = np.moveaxis(np.array(heave), 1, 0)
    of_step, of_precision = np.std(finer - double), np.std(single - double)
    print(f"{name}: payload {of_step:.1e} m from halving the step, {of_precision:.1e} m from float32")
    assert of_precision < 0.2 * of_step


@on_each_device
@pytest.mark.parametrize("name", ["sea_state_5", "snap", "unknown_linear"])
def test_a_state_goes_to_the_device_and_back_unchanged(name, device):
    scenario = load(name)
    one, other = both(scenario, 3, device=device)
    for _ in range(60):
        one.advance(compensating(one).astype(np.float64))
    other.take_from(one)
    third = Plant(scenario, 3)
    other.give_to(third)
    assert np.array_equal(one.observation, third.observation)
    for _ in range(60):
        actions = compensating(one)
        step_both(one, other, actions)
        third.advance(actions.astype(np.float64))
        assert np.array_equal(one.observation, third.observation)
        assert np.array_equal(one.channels, third.channels)
    assert np.allclose(one.channel("payload_heave"), other.channel("payload_heave"), rtol=0, atol=1e-11)


def test_a_state_of_another_batch_is_refused():
    _, other = both(load("thesis_linear"), 2, device="cpu")
    with pytest.raises(ValueError, match="the plant's batch is 3, this one's 2"):
        other.take_from(Plant(load("thesis_linear"), 3))
    with pytest.raises(ValueError, match="the plant's dtype is 'float32', this one's 'float64'"):
        other.give_to(Plant(load("thesis_linear"), 2, dtype="float32"))


def soft(scenario):
    return dataclasses.replace(scenario, cable=dataclasses.replace(scenario.cable, cubic_hardening=10.0))


def distorted(scenario):
    return dataclasses.replace(scenario, sensors=(Sensor(channel="payload_heave", bias=0.1),))


@pytest.mark.parametrize(
    ("scenario", "key"),
    [
        (load("hybrid"), "compensator"),
        (soft(load("sea_state_5")), "cable"),
        (distorted(load("sea_state_5")), "sensors"),
    ],
)
def test_what_the_kernels_do_not_know_is_refused(scenario, key):
    with pytest.raises(ValueError, match=rf"Scenario\.{key} must be .* run it with HeaveVectorEnv"):
        form_of(scenario, "float64")


def test_a_recorded_sea_is_refused(tmp_path):
    path = tmp_path / "motion.csv"
    path.write_text("time,heave\n" + "".join(f"{0.1 * i},{np.sin(0.1 * i)}\n" for i in range(9000)))
    scenario = load("sea_state_5")
    sea = dataclasses.replace(scenario.sea_state, kind="recorded", recording=str(path))
    with pytest.raises(ValueError, match=r"Scenario\.sea_state\.kind must be no recording"):
        form_of(dataclasses.replace(scenario, vessel=None, sea_state=sea), "float64")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"device": "tpu"}, "device must be one of .* got 'tpu'"),
        ({"num_envs": 0}, "num_envs must be a positive whole number"),
        ({"dtype": "float16"}, "dtype must be one of"),
        ({"max_episode_steps": 0}, "max_episode_steps must be a positive whole number"),
    ],
)
def test_impossible_arguments_are_refused(arguments, sentence):
    with pytest.raises(ValueError, match=sentence):
        HeaveTorchVectorEnv("thesis_linear", **{"num_envs": 2, "device": "cpu", **arguments})


def test_without_warp_a_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "warp", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'heave-env\[gpu\]'") as caught:
        HeaveTorchVectorEnv("thesis_linear", 2, device="cpu")
    assert caught.value.name == "warp-lang"


# The torch face ----------------------------------------------------------------------------------


def tensor(env, array):
    return torch.as_tensor(np.asarray(array, dtype=np.float32).reshape(-1, 1), device=env.device)


@on_each_device
@pytest.mark.parametrize("name", ["sea_state_5", "unknown_linear"])
def test_the_torch_batch_is_the_native_batch(name, device):
    n, steps = 5, 25
    options = {"max_episode_steps": steps, "information_set": "sensors_history"}
    env = HeaveTorchVectorEnv(name, n, device=device, dtype="float64", info=True, **options)
    native = HeaveVectorEnv(name, n, autoreset_mode="SameStep", **options)
    seen, _ = env.reset(seed=3)
    expected, _ = native.reset(seed=3)
    assert env.single_observation_space == native.single_observation_space
    rng = np.random.default_rng(0)
    ends = 0
    for _ in range(3 * steps):
        assert seen.dtype == torch.float32 and tuple(seen.shape) == expected.shape
        assert np.allclose(seen.cpu(), expected, rtol=0, atol=2e-6)
        actions = rng.uniform(-0.3, 0.3, n).astype(np.float32)
        seen, reward, terminated, truncated, info = env.step(tensor(env, actions))
        expected, gained, ended, timed_out, told = native.step(actions[:, None])
        assert np.allclose(reward.cpu(), gained, rtol=1e-8, atol=0)
        assert np.array_equal(terminated.cpu(), ended) and np.array_equal(truncated.cpu(), timed_out)
        assert np.allclose(info["payload_heave"].cpu(), told["payload_heave"], rtol=0, atol=1e-10)
        if timed_out.any():
            ends += 1
            last, meant = info["final_obs"].cpu().numpy(), np.stack(told["final_obs"])
            assert np.array_equal(info["_final_obs"].cpu(), told["_final_obs"])
            assert np.allclose(last, meant, rtol=0, atol=2e-6)
            final = info["final_info"]
            assert np.allclose(
                final["payload_heave"].cpu(), told["final_info"]["payload_heave"], rtol=0, atol=1e-10
            )
            assert not final["outcome"].any()
    assert ends == 3


@on_each_device
def test_row_i_is_the_single_environment_of_seed_s_plus_i(device):
    env = HeaveTorchVectorEnv("snap", 3, device=device, dtype="float64")
    seen, _ = env.reset(seed=40)
    alone = HeaveEnv("snap")
    observation, _ = alone.reset(seed=42)
    for k in range(40):
        assert np.allclose(seen[2].cpu(), observation, rtol=0, atol=2e-6)
        seen, reward, *_ = env.step(tensor(env, np.full(3, 0.1 * np.sin(0.3 * k))))
        observation, gained, *_ = alone.step(np.array([np.float32(0.1 * np.sin(0.3 * k))]))
        assert float(reward[2]) == pytest.approx(gained, rel=1e-8)


@on_each_device
def test_an_end_that_is_no_time_limit_is_told_and_begun_anew(device):
    options = {"overrides": {"task.landing_depth": 50.7}}
    env = HeaveTorchVectorEnv("lowering", 6, device=device, dtype="float64", info=True, **options)
    native = HeaveVectorEnv("lowering", 6, autoreset_mode="SameStep", **options)
    env.reset(seed=0), native.reset(seed=0)
    landed = 0
    for _ in range(300):
        _, reward, terminated, truncated, info = env.step(tensor(env, np.zeros(6)))
        _, gained, ended, *_ = native.step(np.zeros((6, 1)))
        assert np.array_equal(terminated.cpu(), ended) and not truncated.any()
        assert np.array_equal(info["final_info"]["outcome"].cpu() == 3, ended)
        assert np.allclose(reward.cpu(), gained, rtol=1e-7, atol=0)
        landed += int(ended.sum())
    assert landed > 0
    assert np.array_equal(env.plant.steps(), native.plant.steps())


@on_each_device
def test_an_action_that_is_no_number_ends_its_row_alone(device):
    env = HeaveTorchVectorEnv("sea_state_5", 3, device=device)
    env.reset(seed=0)
    actions = np.zeros(3)
    actions[1] = np.nan
    for _ in range(4):  # the command is late
        seen, reward, terminated, _, info = env.step(tensor(env, actions))
        if terminated.any():
            break
        actions[1] = 0.0
    assert terminated.tolist() == [False, True, False]
    assert info["final_info"]["outcome"].tolist() == [0, 1, 0]
    assert torch.isfinite(seen).all() and torch.isfinite(reward).all()


@on_each_device
def test_rows_begin_anew_when_asked_and_states_come_back(device):
    env = HeaveTorchVectorEnv("sea_state_5", 4, device=device)
    env.reset(seed=7)
    for _ in range(5):
        env.step(tensor(env, np.full(4, 0.1)))
    mask = np.array([True, False, False, True])
    before = env.plant.numpy("observation").T
    seen = env.reset_rows(torch.as_tensor(mask, device=env.device)).clone()
    assert np.array_equal(env.plant.steps(), np.where(mask, 0, 5))
    assert np.array_equal(seen.cpu().numpy()[~mask], before[~mask])
    assert not np.array_equal(seen.cpu().numpy()[mask], before[mask])
    state = env.get_state()
    first = [env.step(tensor(env, np.full(4, 0.2)))[0].clone() for _ in range(3)]
    env.set_state(state)
    again = [env.step(tensor(env, np.full(4, 0.2)))[0].clone() for _ in range(3)]
    assert all(torch.equal(a, b) for a, b in zip(first, again, strict=True))
    with pytest.raises(ValueError, match="restore it into the scenario, batch and dtype it came from"):
        HeaveTorchVectorEnv("sea_state_5", 5, device=device).set_state(state)
    seen, _ = env.reset(seed=7, options={"reset_mask": mask})
    assert np.array_equal(env.plant.numpy("counters")[1], [0, 0, 0, 0])
    with pytest.raises(ValueError, match="reset_mask must be a bool array of shape"):
        env.reset(options={"reset_mask": np.zeros(4, dtype=bool)})
    with pytest.raises(ValueError, match=r"action must have shape \(4, 1\), got \(3, 1\)"):
        env.step(torch.zeros(3, 1))


def test_what_comes_back_are_views_of_the_devices_arrays():
    env = HeaveTorchVectorEnv("thesis_linear", 3, device="cpu", dtype="float32")
    seen, _ = env.reset(seed=0)
    there = env.plant.buffers
    assert seen.data_ptr() == there.observation.ptr
    _, reward, terminated, truncated, info = env.step(torch.zeros(3, 1))
    arrays = (there.reward, there.terminated, there.truncated, there.final_observation)
    for value, array in zip((reward, terminated, truncated, info["final_obs"]), arrays, strict=True):
        assert value.data_ptr() == array.ptr
    assert reward.dtype == torch.float32 and terminated.dtype == torch.bool


def test_the_kernels_compile_for_a_cuda_card(tmp_path):
    # Ahead of time, which takes no card. Local arrays would lie in slow memory: there must be none.
    module = kernels(form_of(load("sea_state_5"), "float32")).advance.module
    try:
        wp.compile_aot_module(module, arch=80, module_dir=tmp_path, use_ptx=True)
    except RuntimeError as error:
        pytest.skip(f"this build of Warp has no CUDA compiler: {error}")
    source = next(tmp_path.glob("*.ptx")).read_text()
    assert source.count(".visible .entry") == 2
    assert ".local " not in source


@pytest.mark.skipif("cuda" not in DEVICES, reason="there is no CUDA card")
def test_a_graph_does_what_its_steps_do():
    envs = [HeaveTorchVectorEnv("sea_state_5", 64, device="cuda", cuda_graph=flag) for flag in (True, False)]
    rng = np.random.default_rng(0)
    for env in envs:
        env.reset(seed=0)
    for _ in range(50):
        actions = rng.uniform(-1, 1, 64)
        seen = [env.step(tensor(env, actions))[0].clone() for env in envs]
        assert torch.equal(*seen)
