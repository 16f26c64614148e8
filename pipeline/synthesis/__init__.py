"""From inpainted statistics to a picture: noise, shaped and put into the holes."""
