"""What tus 1.0 says in headers: lengths, names, checksums. Pure."""

from __future__ import annotations

import base64
import binascii
import hashlib
import re
from dataclasses import dataclass

from starlette.datastructures import Headers

from app.errors import ApiError, BadRequest
from app.schemas.common import LONGEST_NAME

VERSION = "1.0.0"
EXTENSIONS = "creation,creation-with-upload,termination,expiration,checksum"
#: Names of hashes in Upload-Checksum; sha1 is the one that the protocol asks every server for.
ALGORITHMS = ("sha256", "sha1")
BODY_TYPE = "application/offset+octet-stream"
#: 10^18 bytes: no disk holds more, and every number below fits the store's 64 bits.
LENGTH = re.compile(r"[0-9]{1,18}", re.ASCII)


class TusError(ApiError):
    """An answer that only this protocol knows."""

    def __init__(self, status: int, code: str, text: str) -> None:
        super().__init__(code, text)
        self.status = status


@dataclass(frozen=True, slots=True)
class Checksum:
    """What the bytes of one request hash to."""

    algorithm: str
    digest: bytes


@dataclass(frozen=True, slots=True)
class Announcement:
    """What a new upload says of itself.   sha256: of the whole file, hexadecimal."""

    name: str
    size_bytes: int
    sha256: str | None


def announcement_of(headers: Headers) -> Announcement:
    """The new upload that the headers announce, or BadRequest."""
    if "upload-concat" in headers or "upload-defer-length" in headers:
        raise BadRequest("upload.extension", "Uploads here are single files of known length; send Upload-Length only.")
    size_bytes = number_of(headers, "upload-length")
    if size_bytes == 0:
        raise BadRequest("upload.empty", "The file is empty; choose a recording with messages in it.")
    metadata = _metadata(headers.get("upload-metadata", ""))
    if "filename" not in metadata:
        raise BadRequest("upload.no_name", "The upload has no name; send `filename` in Upload-Metadata.")
    if len(metadata["filename"]) > LONGEST_NAME:
        raise BadRequest(
            "upload.name", f"The name of an upload may have {LONGEST_NAME} characters; send a shorter one."
        )
    sha256 = metadata.get("sha256")
    if sha256 is not None and re.fullmatch(r"[0-9a-fA-F]{64}", sha256) is None:
        raise BadRequest("upload.sha256", "Expected 64 hexadecimal digits as `sha256` in Upload-Metadata; correct it.")
    return Announcement(metadata["filename"], size_bytes, None if sha256 is None else sha256.lower())


def number_of(headers: Headers, name: str) -> int:
    """The header's number of bytes, or BadRequest."""
    text = headers.get(name, "")
    if LENGTH.fullmatch(text) is None:
        raise BadRequest("upload.no_length", f"Expected a number of bytes in the header {name}, found {text[:40]!r}.")
    return int(text)


def checksum_of(headers: Headers) -> Checksum | None:
    """The checksum of the request's bytes; None where it has none."""
    text = headers.get("upload-checksum")
    if text is None:
        return None
    algorithm, _, encoded = text.partition(" ")
    try:
        digest = base64.b64decode(encoded, validate=True)
        if algorithm in ALGORITHMS and len(digest) == hashlib.new(algorithm, usedforsecurity=False).digest_size:
            return Checksum(algorithm, digest)
    except (binascii.Error, ValueError):
        pass
    raise TusError(
        400, "upload.checksum_unknown", f"Expected Upload-Checksum as one of {', '.join(ALGORITHMS)} in base64."
    )


def check_body(headers: Headers) -> None:
    """Raise unless the body is declared as a part of an upload."""
    if headers.get("content-type", "").partition(";")[0].strip().lower() != BODY_TYPE:
        raise TusError(415, "upload.content_type", f"The bytes of an upload are sent with Content-Type {BODY_TYPE}.")


def _metadata(text: str) -> dict[str, str]:
    pairs: dict[str, str] = {}
    for pair in text.split(","):
        key, _, encoded = pair.strip().partition(" ")
        try:
            pairs[key] = base64.b64decode(encoded.strip(), validate=True).decode("utf-8")
        except (binascii.Error, ValueError):
            raise BadRequest(
                "upload.metadata", f"Expected `name base64` pairs in Upload-Metadata, found {pair[:40]!r}; correct it."
            ) from None
    return pairs
