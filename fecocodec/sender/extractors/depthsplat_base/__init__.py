"""The larger extractor: DepthSplat-Base up to its features at full resolution (Xu et al., "DepthSplat", 2025).

An independent implementation upon the blocks of `depthsplat_small`. Module names match those of the public checkpoints.
"""
