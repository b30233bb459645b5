"""The paper's extractor: DepthSplat-Small up to its fused features at 1/4 resolution (Xu et al., "DepthSplat", 2025).

An independent implementation. Module names match those of the public checkpoints, so that their weights can be loaded.
"""
