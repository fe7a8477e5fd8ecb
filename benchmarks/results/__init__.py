"""The figures of the results that follow from sources, settings and images alone: computed, kept, written down."""
