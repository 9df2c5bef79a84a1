"""Sources of touch that are added to any robot: tactile hands and loose sensors. One folder for each device
or kind of connection, with a class derived from `tci.drivers.source.Source`, which only measures."""
