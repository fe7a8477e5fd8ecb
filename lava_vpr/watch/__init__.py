"""Live sources of images, watched: where each image was taken, as it comes; and the page that shows it."""
