"""The `fecosplat` command: parse, call the library, print. One file a command."""
