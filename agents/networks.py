"""Stable-Baselines3 policies whose action mean is a network plus a linear map of the observation.

Active heave compensation is nearly linear, so that a linear skip from observation to action holds most
of the answer and the network only the rest. Observations are whitened inside the policy by a frozen
matrix, which is saved with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from sb3_contrib import TQC, RecurrentPPO
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from sb3_contrib.tqc.policies import Actor as TqcActor
from sb3_contrib.tqc.policies import Critic as TqcCritic
from sb3_contrib.tqc.policies import TQCPolicy
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy, ContinuousCritic
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, MlpExtractor
from stable_baselines3.sac.policies import Actor as SacActor
from stable_baselines3.sac.policies import SACPolicy
from stable_baselines3.td3.policies import Actor as Td3Actor
from stable_baselines3.td3.policies import TD3Policy
from torch import nn

from agents.policy import Architecture, TrainedPolicy

ACTIVATIONS: dict[str, type[nn.Module]] = {"tanh": nn.Tanh, "relu": nn.ReLU}
"""Activations that a saved policy can name."""


class WhitenedFeatures(BaseFeaturesExtractor):
    """Observation times a frozen matrix, cut off at a bound.

    The bound keeps a row that has run wild from ruling the gradient: whitened components are of unit
    size under good control, and hundreds without it.
    """

    def __init__(self, observation_space: Any, transform: np.ndarray, bound: float) -> None:
        super().__init__(observation_space, len(transform))
        self.bound = bound
        self.transform: torch.Tensor
        # Contiguous, as it will be when restored: another stride is another order of summation.
        self.register_buffer("transform", torch.tensor(transform, dtype=torch.float32).contiguous())

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        return torch.clamp(observations @ self.transform.T, -self.bound, self.bound)


class Skip(nn.Module):
    """The layers' output with their input behind it, so that a linear layer on top sees both."""

    def __init__(self, layers: nn.Module) -> None:
        super().__init__()
        self.layers = layers

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        return torch.cat([self.layers(features), features], dim=-1)


class SkipExtractor(MlpExtractor):
    """Separate networks of actor and critic; the actor's latent holds its features too.

    The actor sees the first `n_actor` features, the critic all of them.
    """

    def __init__(self, feature_dim: int, n_actor: int, **kwargs: Any) -> None:
        super().__init__(feature_dim, **kwargs)
        self.n_actor = n_actor
        if n_actor < feature_dim:
            self.policy_net = MlpExtractor(n_actor, **kwargs).policy_net
        self.latent_dim_pi += n_actor

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        seen = features[..., : self.n_actor]
        return torch.cat([self.policy_net(seen), seen], dim=-1)


class SkipActorCriticPolicy(ActorCriticPolicy):
    """PPO's policy with the linear skip, and a critic that may see what the actor does not."""

    def __init__(self, *args: Any, n_actor: int | None = None, **kwargs: Any) -> None:
        self.n_actor = n_actor
        super().__init__(*args, **kwargs)

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = SkipExtractor(
            self.features_dim,
            self.features_dim if self.n_actor is None else self.n_actor,
            net_arch=self.net_arch,
            activation_fn=self.activation_fn,
            device=self.device,
        )


class RecurrentSkipPolicy(RecurrentActorCriticPolicy):
    """RecurrentPPO's policy: features stand beside the LSTM's output, and both beside the hidden layers'."""

    @staticmethod
    def _process_sequence(
        features: torch.Tensor,
        lstm_states: tuple[torch.Tensor, torch.Tensor],
        episode_starts: torch.Tensor,
        lstm: nn.LSTM,
    ) -> tuple[torch.Tensor, Any]:
        output, states = RecurrentActorCriticPolicy._process_sequence(
            features, lstm_states, episode_starts, lstm
        )
        return torch.cat([output, features], dim=-1), states

    def _build_mlp_extractor(self) -> None:
        width = self.lstm_output_dim + self.features_dim
        self.mlp_extractor = SkipExtractor(
            width, width, net_arch=self.net_arch, activation_fn=self.activation_fn, device=self.device
        )


def _n_actions(space: Any) -> int:
    return int(space.shape[0])


def _give_skip(actor: SacActor | TqcActor) -> None:
    """Puts the linear skip into an actor that squashes a Gaussian."""
    wide, n_actions = actor.net_arch[-1] + actor.features_dim, _n_actions(actor.action_space)
    actor.latent_pi = Skip(actor.latent_pi)  # type: ignore[assignment]
    actor.mu = nn.Linear(wide, n_actions)
    actor.log_std = nn.Linear(wide, n_actions)  # type: ignore[assignment]


class SkipSacActor(SacActor):
    """SAC's actor with the linear skip."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        _give_skip(self)


class SkipTqcActor(TqcActor):
    """TQC's actor with the linear skip."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        _give_skip(self)


class SkipTd3Actor(Td3Actor):
    """TD3's actor with the linear skip."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        *hidden, _, squash = self.mu
        wide = nn.Linear(self.net_arch[-1] + self.features_dim, _n_actions(self.action_space))
        self.mu = nn.Sequential(Skip(nn.Sequential(*hidden)), wide, squash)


class QuadraticSkip(nn.Module):
    """The layers' output plus a quadratic form of their input, of low rank, which begins at nothing.

    Where the plant is linear and the cost quadratic so is the value of an action, and its slope decides
    where an actor goes: a network alone learns that slope badly.
    """

    def __init__(self, layers: nn.Module, n_inputs: int, n_outputs: int, rank: int) -> None:
        super().__init__()
        self.layers = layers
        self.directions = nn.Linear(n_inputs, rank)
        self.curvature = nn.Linear(rank, n_outputs, bias=False)
        nn.init.zeros_(self.curvature.weight)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.layers(x) + self.curvature(self.directions(x) ** 2)


def _give_quadratic(critic: ContinuousCritic | TqcCritic, n_outputs: int, rank: int) -> None:
    """Puts the quadratic skip into each of a critic's networks."""
    networks: list[Any] = critic.q_networks
    for i, network in enumerate(networks):
        networks[i] = QuadraticSkip(network, network[0].in_features, n_outputs, rank)
        critic.add_module(f"qf{i}", networks[i])


class SkipSacPolicy(SACPolicy):
    """SAC's policy: the actor with the linear skip, and critics that may have the quadratic one."""

    def __init__(self, *args: Any, quadratic_rank: int = 0, **kwargs: Any) -> None:
        self.quadratic_rank = quadratic_rank
        super().__init__(*args, **kwargs)

    def make_actor(self, features_extractor: BaseFeaturesExtractor | None = None) -> SacActor:
        kwargs = self._update_features_extractor(self.actor_kwargs, features_extractor)
        return SkipSacActor(**kwargs).to(self.device)

    def make_critic(self, features_extractor: BaseFeaturesExtractor | None = None) -> ContinuousCritic:
        critic = super().make_critic(features_extractor)
        if self.quadratic_rank:
            _give_quadratic(critic, 1, self.quadratic_rank)
        return critic.to(self.device)


class SkipTd3Policy(TD3Policy):
    """TD3's policy, likewise."""

    def __init__(self, *args: Any, quadratic_rank: int = 0, **kwargs: Any) -> None:
        self.quadratic_rank = quadratic_rank
        super().__init__(*args, **kwargs)

    def make_actor(self, features_extractor: BaseFeaturesExtractor | None = None) -> Td3Actor:
        kwargs = self._update_features_extractor(self.actor_kwargs, features_extractor)
        return SkipTd3Actor(**kwargs).to(self.device)

    def make_critic(self, features_extractor: BaseFeaturesExtractor | None = None) -> ContinuousCritic:
        critic = super().make_critic(features_extractor)
        if self.quadratic_rank:
            _give_quadratic(critic, 1, self.quadratic_rank)
        return critic.to(self.device)


class SkipTqcPolicy(TQCPolicy):
    """TQC's policy, likewise; the quadratic form of a critic's network shifts and spreads its quantiles."""

    def __init__(self, *args: Any, quadratic_rank: int = 0, **kwargs: Any) -> None:
        self.quadratic_rank = quadratic_rank
        super().__init__(*args, **kwargs)

    def make_actor(self, features_extractor: BaseFeaturesExtractor | None = None) -> TqcActor:
        kwargs = self._update_features_extractor(self.actor_kwargs, features_extractor)
        return SkipTqcActor(**kwargs).to(self.device)

    def make_critic(self, features_extractor: BaseFeaturesExtractor | None = None) -> TqcCritic:
        critic = super().make_critic(features_extractor)
        if self.quadratic_rank:
            _give_quadratic(critic, critic.n_quantiles, self.quadratic_rank)
        return critic.to(self.device)


# Where a training starts -------------------------------------------------------------------------


def set_linear_policy(model: BaseAlgorithm, gain: np.ndarray) -> None:
    """Makes the actor's mean that linear map of the whitened components, (n_observations,)."""
    output: Any = model.policy.get_submodule(_PARTS[type(model)][1])
    with torch.no_grad():
        output.weight *= 0.01
        output.bias.zero_()
        output.weight[0, -len(gain) :] = torch.as_tensor(gain, dtype=torch.float32)
    target: Any = getattr(model, "actor_target", None)
    if target is not None:
        target.load_state_dict(model.actor.state_dict())  # type: ignore[attr-defined]


def actor_mean(model: BaseAlgorithm, observations: torch.Tensor) -> torch.Tensor:
    """The actor's mean action before it is cut off or squashed, (n, 1), with its gradient."""
    policy: Any = model.policy
    if type(model) is PPO:
        return policy.action_net(policy.mlp_extractor.forward_actor(policy.extract_features(observations)))
    features = policy.actor.extract_features(observations, policy.actor.features_extractor)
    if isinstance(model, TD3):
        return policy.actor.mu(features)
    return torch.tanh(policy.actor.mu(policy.actor.latent_pi(features)))


def actor_sequence(
    model: RecurrentPPO, observations: torch.Tensor, memory: tuple[torch.Tensor, torch.Tensor] | None
) -> tuple[torch.Tensor, tuple[torch.Tensor, torch.Tensor]]:
    """The mean action of an actor with a memory over a stretch of an episode, with its gradient.

    Args:
        model: The algorithm.
        observations: Step by step, (n_steps, n_rows, n_observations).
        memory: The LSTM's output and cell before the first, each (1, n_rows, width); None begins afresh.

    Returns:
        Actions before they are cut off, (n_steps, n_rows, 1), and the memory after the last.
    """
    policy: Any = model.policy
    shape = observations.shape[:2]
    features = policy.extract_features(observations.flatten(0, 1)).unflatten(0, shape)
    output, memory = policy.lstm_actor(features, memory)
    seen = torch.cat([output, features], dim=-1)
    return policy.action_net(policy.mlp_extractor.forward_actor(seen)), memory


def hold_actor(model: BaseAlgorithm, held: bool) -> None:
    """Makes the actor stand still, or lets it learn."""
    policy: Any = model.policy
    if isinstance(model, OnPolicyAlgorithm):
        policy.mlp_extractor.policy_net.requires_grad_(not held)
        policy.action_net.requires_grad_(not held)
        policy.log_std.requires_grad_(not held)
        if isinstance(model, RecurrentPPO):
            policy.lstm_actor.requires_grad_(not held)
    else:
        policy.actor.requires_grad_(not held)


def set_exploration(model: BaseAlgorithm, log_std: float) -> None:
    """Makes that the logarithm of SAC's or TQC's initial standard deviation, whatever it sees."""
    layer: Any = model.policy.get_submodule("actor.log_std")
    with torch.no_grad():
        layer.weight.zero_()
        layer.bias.fill_(log_std)


# What a saved policy holds -----------------------------------------------------------------------

_PARTS: dict[type[BaseAlgorithm], tuple[str, str, str]] = {
    PPO: ("mlp_extractor.policy_net", "action_net", "clip"),
    RecurrentPPO: ("mlp_extractor.policy_net", "action_net", "clip"),
    SAC: ("actor.latent_pi.layers", "actor.mu", "tanh"),
    TQC: ("actor.latent_pi.layers", "actor.mu", "tanh"),
    TD3: ("actor.mu.0.layers", "actor.mu.1", "tanh"),
}
"""Of each algorithm: its actor's hidden layers and output layer, and how the output becomes an action."""


def exported(model: BaseAlgorithm, card: Mapping[str, Any]) -> TrainedPolicy:
    """The deterministic actor of an algorithm with one of this module's policies, for plain NumPy.

    Args:
        model: The algorithm.
        card: What is known of the policy; see `agents.policy.policy_card`.
    """
    layers_name, output_name, output = _PARTS[type(model)]
    policy: Any = model.policy
    hidden: Any = policy.get_submodule(layers_name)
    layers = [layer for layer in hidden if isinstance(layer, nn.Linear)]
    activations = {name for layer in hidden for name, kind in ACTIVATIONS.items() if isinstance(layer, kind)}
    actor = getattr(policy, "actor", None)
    features = policy.features_extractor if actor is None else actor.features_extractor
    last = policy.get_submodule(output_name)
    tensors: dict[str, torch.Tensor] = {}
    n, memory = layers[0].in_features, 0
    if isinstance(policy, RecurrentActorCriticPolicy):
        lstm: Any = policy.lstm_actor
        n, memory = lstm.input_size, lstm.hidden_size
        tensors |= {
            "memory.weight": lstm.weight_ih_l0,
            "memory.recurrent_weight": lstm.weight_hh_l0,
            "memory.bias": lstm.bias_ih_l0 + lstm.bias_hh_l0,
        }
    # What only the critic sees stands last.
    tensors |= {
        "features.weight": features.transform[:n, :n],
        "output.weight": last.weight,
        "output.bias": last.bias,
    }
    for i, layer in enumerate(layers):
        tensors |= {f"hidden.{i}.weight": layer.weight, f"hidden.{i}.bias": layer.bias}
    architecture = Architecture(
        n_observations=n,
        feature_bound=float(features.bound),
        hidden=tuple(layer.out_features for layer in layers),
        activation=activations.pop(),
        output=output,
        memory=memory,
    )
    weights = {name: tensor.detach().cpu().numpy().copy() for name, tensor in tensors.items()}
    return TrainedPolicy(architecture, weights, card)
