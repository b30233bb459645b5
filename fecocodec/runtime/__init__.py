"""The receiver without torch: the exported graphs of a model, run by onnxruntime."""
