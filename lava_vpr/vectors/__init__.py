"""Files of vectors: descriptors that another program made of each image, with names, positions and times beside."""
