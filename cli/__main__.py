"""`python -m fecosplat_cli`, the same as `fecosplat`."""

from .main import main

if __name__ == "__main__":
    main()
