"""Methods side by side on damaged shapes whose intact symmetries are known: corruptions, matching, reports.

Knows `model`, `training.oracle` and `training.baselines`; never the trainer.
"""
