"""The fill method `shift-map`: one whole-pixel shift per tile of the hole."""
