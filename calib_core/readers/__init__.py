"""Foreign recordings -> types.Recording. See load.py for the whole way, container/ for what can be opened."""

from calib_core.readers.container.fingerprint import recording_sha256
from calib_core.readers.container.opening import OpenRecording, open_recording
from calib_core.readers.load import load

__all__ = ["OpenRecording", "load", "open_recording", "recording_sha256"]
