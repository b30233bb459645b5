"""`python -m fecocodec`: the library has no command of its own."""

import sys

if __name__ == "__main__":
    sys.exit("fecocodec is the library; run the command as `fecosplat`, or as `python -m fecosplat_cli`.")
