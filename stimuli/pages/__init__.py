"""Pages of pictures: the contact sheet of a batch, and the views of a scene."""
