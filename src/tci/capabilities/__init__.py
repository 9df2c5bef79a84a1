"""Behaviours (Fig. 2, L4): one ABC, and the force-distance withdrawal reflex (eqs 5-7)."""
