"""PPO and MaskablePPO of Stable-Baselines3 whose gradients are computed in closed form.

Automatic differentiation of networks as small as a policy's takes as long as their arithmetic. What is
learned is the same but for rounding.
"""
