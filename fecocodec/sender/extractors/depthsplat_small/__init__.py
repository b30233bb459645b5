"""The paper's extractor: DepthSplat-Small up to its fused features at 1/4 resolution (Xu et al., "DepthSplat", 2025).

Written anew from the description of the network; modules are called as in the public checkpoints, so that those load.
"""
