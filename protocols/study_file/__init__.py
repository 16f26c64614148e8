"""The study file: its sections, the rules between them, and the text of a new one."""
