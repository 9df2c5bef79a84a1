"""Trains a policy to withdraw, on NAO alone, and writes it with all that it needs into one file.

python examples/learning/train.py withdraw.onnx

It learns from the hand-written reflex: it acts, and the reflex says what it would have done (DAgger, Ross et
al. 2011). Needs PyTorch, and the extras gym and onnx. Takes about a minute.
"""

import sys

import numpy as np
import torch

from tci.capabilities.policy import PolicySpec, write_policy
from tci.learn import TouchEnv

ROUNDS, EPISODES, EPOCHS = 5, 60, 60
# It sees the touches of the last 1.5 s and not where the arm is. One that saw its own offset learned to stay
# where it had gone, and drifted by 16 degrees in 5 s where nobody touched it.
spec = PolicySpec(observations=("contacts",), rate=20.0, history=30, action_scale=[1.2] * 5)
env = TouchEnv("nao", policy=spec)

torch.manual_seed(0)
inputs, joints = env.observation_space.shape[0], env.action_space.shape[0]
network = torch.nn.Sequential(
    torch.nn.Linear(inputs, 32), torch.nn.Tanh(), torch.nn.Linear(32, 32), torch.nn.Tanh(),
    torch.nn.Linear(32, joints),
)  # fmt: skip


def act(seen):
    with torch.no_grad():
        return network(torch.as_tensor(seen)).numpy()


saw, should = [], []
for turn in range(ROUNDS):
    returns = []
    for episode in range(EPISODES):
        seen, _ = env.reset(seed=1000 * turn + episode)
        total, over = 0.0, False
        while not over:
            answer = env.baseline()
            saw.append(seen)
            should.append(answer)
            seen, reward, _, over, _ = env.step(answer if turn == 0 else act(seen))
            total += reward
        returns.append(total)
    print(f"round {turn}: return {np.mean(returns):.4f}", "of the reflex" if turn == 0 else "of the policy")
    x, y = torch.as_tensor(np.array(saw)), torch.as_tensor(np.array(should))
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-3, weight_decay=1e-5)
    for _ in range(EPOCHS):
        for rows in torch.randperm(len(x)).split(256):
            optimizer.zero_grad()
            loss = torch.nn.functional.mse_loss(network(x[rows]), y[rows])
            loss.backward()
            optimizer.step()
    print(f"         error {1.2 * float(loss.detach()) ** 0.5:.3f} rad on {len(x)} steps", flush=True)

torch.onnx.export(network, (torch.zeros(1, inputs),), "network.onnx", dynamo=False)
write_policy(sys.argv[1], "network.onnx", env.policy)
