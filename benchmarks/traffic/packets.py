"""The packets of MQTT 3.1.1 that a client writes (OASIS MQTT 3.1.1, chapters 2 and 3)."""

from dataclasses import dataclass

CONNECT, CONNACK, PUBLISH, PUBACK, SUBSCRIBE, SUBACK = 1, 2, 3, 4, 8, 9
ACCEPTED = 0
SUBSCRIPTION_REFUSED = 0x80
LEVEL = 4  # MQTT 3.1.1
_MORE, _RETAIN = 0x80, 0x01


@dataclass(frozen=True)
class PublishPacket:
    """PUBLISH; `packet_id` is 0 at QoS 0."""

    topic: str
    payload: bytes
    qos: int = 0
    retain: bool = False
    packet_id: int = 0


def framed(first: int, body: bytes) -> bytes:
    """Return a packet: its first byte, the length of the body seven bits a byte, the body."""
    header, length = bytearray([first]), len(body)
    while True:
        length, digit = length >> 7, length & 0x7F
        header.append(digit | (_MORE if length else 0))
        if not length:
            return bytes(header) + body


def publish(message: PublishPacket) -> bytes:
    """Return a PUBLISH."""
    topic = message.topic.encode()
    packet_id = message.packet_id.to_bytes(2, "big") if message.qos else b""
    flags = (message.qos << 1) | (_RETAIN if message.retain else 0)
    return framed(
        (PUBLISH << 4) | flags,
        b"".join((len(topic).to_bytes(2, "big"), topic, packet_id, message.payload)),
    )


def puback(packet_id: int) -> bytes:
    """Return a PUBACK."""
    return framed(PUBACK << 4, packet_id.to_bytes(2, "big"))
