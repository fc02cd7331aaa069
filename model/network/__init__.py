"""PRS-Net and its use on a CPU: architecture, checkpoints, fast inference, proposals.

`network`, `sparse_block` run on torch alone, so that training does too; the rest may use `model.geometry`.
"""
