"""What takes room on the disk."""

from __future__ import annotations

from fastapi import APIRouter

from app.schemas.storage import StorageUse
from app.server.deps import ServicesDep

router = APIRouter(prefix="/api/storage", tags=["server"])


@router.get("")
def read_storage(services: ServicesDep) -> StorageUse:
    """What takes room on the server's disk. To make some, delete recordings."""
    return services.keeping.use()
