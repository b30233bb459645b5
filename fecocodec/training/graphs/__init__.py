"""Export of the receiver's networks to ONNX graphs, for `fecocodec.runtime` and for browsers.

Loops are not exported. A step of a loop over views, or a block of points, is a graph that the caller runs repeatedly.
The order of the graphs is that of `fecocodec.runtime.decode` and `fecocodec.runtime.prediction`; `specification` and
`networks` list their inputs and outputs.
"""
