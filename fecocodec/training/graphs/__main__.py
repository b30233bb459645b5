"""`python -m fecocodec.training.graphs FOLDER`: export the graphs of the model in a folder."""

import sys
from pathlib import Path

from fecocodec.training.graphs.export import export_receiver

if __name__ == "__main__":
    export_receiver(Path(sys.argv[1]))
