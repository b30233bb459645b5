"""`fecosplat batch`: encode or decode many scenes, on this machine or on a cluster."""

import click

from .command_line import LazyGroup


@click.group(
    "batch",
    cls=LazyGroup,
    modules={"encode": "batch_encode", "decode": "batch_decode"},
    short_help="Encode or decode many scenes, on this machine or on a cluster.",
    epilog="""\b
Examples:
  fecosplat batch encode scenes/ -o coded/
  fecosplat batch encode manifest.txt -o coded/ --scheduler tcp://host:8786 --effort best
  fecosplat batch encode scenes/ -o coded/ --shard 3/16
  fecosplat batch decode coded/ -o splats/ --format spz""",
)
def command() -> None:
    """Encode or decode many scenes. A run that was interrupted resumes: finished scenes are skipped."""
