"""The figures of the sources, drawn anew."""
