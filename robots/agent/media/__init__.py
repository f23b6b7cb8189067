"""Picture, sound and data channels over WebRTC: see `side` for how they hang together."""

from robots.agent.media.side import MediaSide

__all__ = ["MediaSide"]
