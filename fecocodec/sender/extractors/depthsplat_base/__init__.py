"""DepthSplat-Base's features at full resolution; an independent implementation, upon `depthsplat_small`."""
