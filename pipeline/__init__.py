"""The method: warp, features, statistics, synthesis. Imports none of our other packages."""
