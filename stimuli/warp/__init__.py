"""Single pictures warped, filled, compared and drawn step by step: `metamerlab warp`."""
