"""Covariance matrix adaptation: the evolution strategy of Hansen (2016), arXiv:1604.00772, populations at a time."""

import numpy as np


class EvolutionStrategy:
    """Ask for a population, tell what it is worth; smaller is better."""

    def __init__(self, mean: np.ndarray, sigma: float, rng: np.random.Generator, population: int) -> None:
        n = len(mean)
        self.mean, self.sigma, self.rng, self.population = np.array(mean, dtype=float), sigma, rng, population
        weights = np.log((population + 1) / 2) - np.log(np.arange(1, population // 2 + 1))
        self.weights = weights / weights.sum()
        mu = 1 / (self.weights**2).sum()
        self.c_sigma = (mu + 2) / (n + mu + 5)
        self.damping = 1 + 2 * max(0.0, np.sqrt((mu - 1) / (n + 1)) - 1) + self.c_sigma
        self.c_c = (4 + mu / n) / (n + 4 + 2 * mu / n)
        self.c_1 = 2 / ((n + 1.3) ** 2 + mu)
        self.c_mu = min(1 - self.c_1, 2 * (mu - 2 + 1 / mu) / ((n + 2) ** 2 + mu))
        self.mu, self.expected = mu, np.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n * n))
        self.C, self.path_c, self.path_sigma, self.generation = np.eye(n), np.zeros(n), np.zeros(n), 0

    def ask(self) -> np.ndarray:
        """(population, n)"""
        values, self._B = np.linalg.eigh(self.C)
        self._D = np.sqrt(np.maximum(values, 1e-20))
        y = (self.rng.standard_normal((self.population, len(self.mean))) * self._D) @ self._B.T
        return self.mean + self.sigma * y

    def tell(self, x: np.ndarray, worth: np.ndarray) -> None:
        """x : (population, n) as asked for, or moved onto bounds."""
        best = np.argsort(worth, kind="stable")[: len(self.weights)]
        Y = (x[best] - self.mean) / self.sigma
        y = self.weights @ Y
        self.mean = self.mean + self.sigma * y
        self.generation += 1
        white = self._B @ ((self._B.T @ y) / self._D)
        self.path_sigma = (1 - self.c_sigma) * self.path_sigma + np.sqrt(
            self.c_sigma * (2 - self.c_sigma) * self.mu
        ) * white
        length = np.linalg.norm(self.path_sigma)
        fresh = 1 - (1 - self.c_sigma) ** (2 * self.generation)
        h = float(length / np.sqrt(fresh) < (1.4 + 2 / (len(y) + 1)) * self.expected)
        self.path_c = (1 - self.c_c) * self.path_c + h * np.sqrt(self.c_c * (2 - self.c_c) * self.mu) * y
        left = 1 - self.c_1 - self.c_mu + (1 - h) * self.c_1 * self.c_c * (2 - self.c_c)
        self.C = left * self.C + self.c_1 * np.outer(self.path_c, self.path_c) + self.c_mu * (Y.T * self.weights) @ Y
        self.sigma *= float(np.exp(min(1.0, self.c_sigma / self.damping * (length / self.expected - 1))))
