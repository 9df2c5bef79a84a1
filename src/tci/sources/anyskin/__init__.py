"""AnySkin and ReSkin, magnetometers under a magnetic skin, over a serial port."""
