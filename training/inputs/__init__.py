"""The inputs of the network: batches of meshes, augmented, posed and voxelized on the training device.

Torch and numpy alone; knows neither losses nor the trainer.
"""
