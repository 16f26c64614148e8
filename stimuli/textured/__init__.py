"""Scenes whose surfaces are read as statistics: a planet, and four globes."""
