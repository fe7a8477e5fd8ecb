"""The figures of README's results that follow from sources, settings and images alone: computed, kept, written down."""
