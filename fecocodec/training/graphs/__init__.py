"""Export of the receiver's networks to ONNX graphs, for `fecocodec.runtime` and for browsers."""
