"""Video, sound and data channels over WebRTC; `side` connects the parts."""

from robots.agent.media.side import MediaSide

__all__ = ["MediaSide"]
