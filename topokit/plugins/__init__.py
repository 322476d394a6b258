"""The adapter interface, the registry, and the choice of an adapter for a source."""
