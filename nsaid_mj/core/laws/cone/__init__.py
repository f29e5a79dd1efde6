"""The law in the metric of the cone of physical parameters."""
