"""Quality of clips and pictures against their reference, by the papers' metrics and newer ones."""
