"""An extrinsic that somebody uses, held against a recording: is it still right, and would it have shown if not.

given       extrinsics in other programs' files     limits    how far off is too far
compare     differences, sigmas and verdicts        crisp     the room laid together with theirs and with ours
run         the whole audit of one recording        report    the document
"""
