"""Trained agents: Stable-Baselines3 on the native batch, and saved policies that act without it.

Importing this package, `agents.policy` or `agents.presets` does not import torch.
"""
