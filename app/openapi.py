"""`python -m app.openapi`: the API's document on stdout."""

from __future__ import annotations

import json
import sys

from app.application import create_app
from app.server.document import document
from app.settings import AppSettings


def main() -> None:
    """Write the document to stdout."""
    json.dump(document(create_app(AppSettings())), sys.stdout, indent=2, sort_keys=True)
    sys.stdout.write("\n")


if __name__ == "__main__":
    main()
