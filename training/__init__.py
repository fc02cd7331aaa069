"""Training of PRS-Net: data preparation, the paper's losses, the trainer, evaluation and export."""
