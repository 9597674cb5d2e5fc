"""Foreign recordings -> types.Recording.

`load.load` is the whole way, `container.opening.open_recording` what can be opened, `container.fingerprint` a recording's
hash. Nothing is imported here: a server that clears away what a job has unpacked needs neither decoders nor their compiler.
"""
