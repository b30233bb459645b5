"""What the codec accepts: views, sides of images, stages."""

MAX_VIEWS = 16
MIN_SIDE, MAX_SIDE = 64, 1024  # pixels, of every view
SIDE_MULTIPLE = 32  # pixels; the networks halve a side five times
MAX_STAGES = 2
