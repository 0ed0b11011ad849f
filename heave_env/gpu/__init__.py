"""The plant on a GPU: thousands of environments, torch tensors in and out. See docs/gpu.md.

Needs the extra `gpu` (NVIDIA Warp and torch): `pip install 'heave-env[gpu]'`. Nothing here is imported by the
rest of `heave_env`.
"""
