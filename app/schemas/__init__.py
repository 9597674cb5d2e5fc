"""What goes over the wire, a file a noun: every field with its unit, as the API's document has it."""
