"""Maps that live: a model is extended by places, loses places, or is merged with others, and nothing is learned twice.

What a stretch has learned depends on its own images, the settings and the seed, so it stays, bit for bit. All that
depends on the rest of the map (`lava_vpr.training.loop`) is derived again, and so the same model comes of extending
by images, of merging with a model of them, and of training all of them together in the same stretches.

Places keep their order and names: those of the first model, then the new ones, view by view and traverse by traverse.
HOG descriptors stay where all parts have them, positions have all or none.
An absolute index is kept, too, if the new images are another part of the same traverse, which is assumed where both
traverses have as many images and no index in common; else new indices are counted on after the whole route before.
"""

from lava_vpr.maps.changes import extend, merge, remove

__all__ = ["extend", "merge", "remove"]
