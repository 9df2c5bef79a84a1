"""Reinforcement learning: a Gymnasium environment, simulated rollouts."""
