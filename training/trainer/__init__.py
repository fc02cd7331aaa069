"""The trainer: the paper's losses, the step, checkpoints and records of a run, several processes.

Torch and numpy alone, but for `export` and `curve`.
"""
