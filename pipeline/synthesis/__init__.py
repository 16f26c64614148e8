"""Pictures from inpainted statistics: noise, shaped and put into the holes."""
