"""A camera's frame of either format as a frame of PyAV."""

import av
import numpy as np

from robots.agent.robot_interface import Frame

RGB, YUV = "rgb24", "yuv420p"


def video_frame(frame: Frame) -> av.VideoFrame:
    """Return a frame over the same memory, which must not change while it is used.

    Raises:
        ValueError: the image is neither (height, width, 3) uint8 RGB nor (height * 3 / 2, width)
            uint8 of an even width and height.
    """
    image = frame.image
    if image.dtype != np.uint8 or not _fits(image.shape, frame.format):
        raise ValueError(
            f"an image of shape {image.shape} and type {image.dtype} is not {frame.format}"
        )
    return av.VideoFrame.from_numpy_buffer(np.ascontiguousarray(image), format=frame.format)


def _fits(shape: tuple[int, ...], kind: str) -> bool:
    if kind == RGB:
        return len(shape) == 3 and shape[2] == 3 and min(shape) > 0
    return (
        kind == YUV
        and len(shape) == 2
        and shape[0] % 3 == 0
        and shape[1] % 2 == 0
        and min(shape) > 0
    )
