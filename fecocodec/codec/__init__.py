"""From a folder of photographs to the bytes of a file: what the commands and Python users call."""
