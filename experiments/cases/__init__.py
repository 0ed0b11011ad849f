"""Named cases of every solver: parameters in, quantities, tables and pictures out."""
