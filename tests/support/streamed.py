"""Answers that are streamed."""

from asgiref.sync import async_to_sync
from django.http import StreamingHttpResponse


@async_to_sync
async def body_of(answer: StreamingHttpResponse) -> bytes:
    """Return the whole body of an asynchronously streamed answer."""
    return b"".join([part async for part in answer.streaming_content])
