"""Commands on what people bring: one file each."""
