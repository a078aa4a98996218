"""The names for users of the stages between opening a file and the first handle, and of other tasks."""

STAGES = {  # in order
    "wait": "Waiting for another shape",
    "read": "Reading the file",
    "send": "Drawing the shape",
    "load": "Starting to learn",
    "up": "Finding which way is up",
    "simplify": "Simplifying the shape",
    "render": "Taking pictures of the shape",
    "encode": "Looking at the pictures",
    "smooth": "Combining the pictures",
    "fit": "Learning what looks alike",
    "features": "Comparing the surface",
    "parts": "Finding parts",
}
OTHERS = {"cut": "Finding places for handles"}
ENDS = {"done": "Done", "cancelled": "Cancelled", "failed": "Failed"}  # the last stages of tasks
