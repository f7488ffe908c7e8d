"""The lanelet network of a scenario as a SUMO net: layout, speeds, and the ``.net.xml``. Its face is the network's."""
