"""Player 3: joints as actarray, skin as opaque, client and server over TCP (Gerkey, Vaughan, Howard 2003)."""
