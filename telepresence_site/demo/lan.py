"""To open the demo from a phone: this machine's address, a certificate for it, and a QR code."""

import datetime
import ipaddress
import socket
from pathlib import Path

import ifaddr
import segno
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

DAYS = 397  # validity of a certificate; browsers accept no longer one


def addresses() -> list[str]:
    """Return this machine's IPv4 addresses in its networks, that of the default route first."""
    found = [
        ip.ip for adapter in ifaddr.get_adapters() for ip in adapter.ips if isinstance(ip.ip, str)
    ]
    reachable = [
        ip
        for ip in found
        if not (address := ipaddress.ip_address(ip)).is_loopback and not address.is_link_local
    ]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            # a documentation address: nothing is sent, the kernel only picks a route
            probe.connect(("192.0.2.1", 9))
            first = probe.getsockname()[0]
        except OSError:
            return reachable
    return sorted(reachable, key=lambda ip: ip != first)


def certificate(directory: Path, hosts: list[str]) -> tuple[Path, Path]:
    """Return the files (key, certificate) for these addresses; they are replaced when the addresses
    have changed or the certificate ends within a day.
    """
    directory.mkdir(parents=True, exist_ok=True)
    key_file, certificate_file = directory / "lan.key", directory / "lan.crt"
    if not _is_good(certificate_file, hosts):
        _make(key_file, certificate_file, hosts)
    return key_file, certificate_file


def _names(hosts: list[str]) -> list[x509.GeneralName]:
    names: list[x509.GeneralName] = [x509.DNSName("localhost")]
    return names + [x509.IPAddress(ipaddress.ip_address(host)) for host in hosts]


def _is_good(file: Path, hosts: list[str]) -> bool:
    if not file.exists():
        return False
    known = x509.load_pem_x509_certificate(file.read_bytes())
    names = known.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    return set(names) == set(_names(hosts)) and known.not_valid_after_utc > datetime.datetime.now(
        datetime.UTC
    ) + datetime.timedelta(days=1)


def _make(key_file: Path, certificate_file: Path, hosts: list[str]) -> None:
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "Telepresence demo")])
    now = datetime.datetime.now(datetime.UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(minutes=5))
        .not_valid_after(now + datetime.timedelta(days=DAYS))
        .add_extension(x509.SubjectAlternativeName(_names(hosts)), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    key_file.touch(mode=0o600)
    key_file.write_bytes(
        key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )
    )
    certificate_file.write_bytes(made.public_bytes(serialization.Encoding.PEM))


def qr_code(address: str) -> None:
    segno.make(address, error="l").terminal(compact=True, border=2)
