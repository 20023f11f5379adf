"""`tubelock explore`: a page on this machine with sliders for the parameters of a scene."""
