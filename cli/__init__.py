"""The `fecosplat` command line: parse the arguments, call the library, print the result. One module per command."""
