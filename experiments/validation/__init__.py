"""Every solver held against closed forms, published figures, the others and an independent code."""
