import { describe, expect, it } from "vitest";
import { eulerDeg, inverted } from "../src/features/result/inverse";
import { turnDeg } from "../src/features/solve/turns";

type M = number[][];
const product = (a: M, b: M): M =>
  a.map((row) => (b[0] ?? []).map((_, j) => row.reduce((sum, v, k) => sum + v * (b[k]?.[j] ?? 0), 0)));
const transposed = (m: M): M => (m[0] ?? []).map((_, j) => m.map((row) => row[j] ?? 0));

/** Rotation by a vector, as the power series of the matrix exponential: no closed form shared with the code. */
function turned([x = 0, y = 0, z = 0]: number[]): M {
  const K = [
    [0, -z, y],
    [z, 0, -x],
    [-y, x, 0],
  ];
  let term: M = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ];
  let sum = term;
  for (let n = 1; n < 30; n += 1) {
    term = product(term, K).map((row) => row.map((v) => v / n));
    sum = sum.map((row, i) => row.map((v, j) => v + (term[i]?.[j] ?? 0)));
  }
  return sum;
}

const R = turned([0.4, -1.1, 0.7]);
const p = [0.12, -0.31, 0.08];
const matrix = [...R.map((row, i) => [...row, p[i] ?? 0]), [0, 0, 0, 1]];
const steps = Array.from({ length: 7 }, (_, i) => Array.from({ length: 7 }, (__, j) => Math.sin(3 * i + 5 * j + 1)));
const covariance = product(steps, transposed(steps));

describe("the transform the other way", () => {
  // Fails when the translation is only negated instead of turned too.
  it("undoes the transform", () => {
    const identity = product(matrix, inverted(matrix, covariance).matrix);
    identity.forEach((row, i) => row.forEach((value, j) => expect(value).toBeCloseTo(i === j ? 1 : 0, 12)));
  });

  // Fails when [p']x is taken with the other sign, or when the rotation's covariance is not turned to the IMU's axes.
  it("carries the covariance over as finite differences do", () => {
    const h = 1e-6;
    const inverseOf = (step: number[]) => {
      const turnedR = product(R, turned(step.slice(0, 3)));
      const Rt = transposed(turnedR);
      const moved = p.map((value, i) => [value + (step[3 + i] ?? 0)]);
      return { Rt, t: product(Rt, moved).map((row) => -(row[0] ?? 0)) };
    };
    const base = inverseOf([0, 0, 0, 0, 0, 0]);
    const columns = Array.from({ length: 6 }, (_, k) => {
      const plus = inverseOf(Array.from({ length: 6 }, (__, i) => (i === k ? h : 0)));
      // The right perturbation of the inverse: base^T plus = I + [r']x.
      const D = product(transposed(base.Rt), plus.Rt);
      return [
        D[2]?.[1] ?? 0,
        D[0]?.[2] ?? 0,
        D[1]?.[0] ?? 0,
        ...plus.t.map((value, i) => value - (base.t[i] ?? 0)),
      ].map((value) => value / h);
    });
    const J = transposed(columns);
    const cov6 = covariance.slice(0, 6).map((row) => row.slice(0, 6));
    const expected = product(product(J, cov6), columns);
    const made = inverted(matrix, covariance);
    [0, 1, 2].forEach((i) => {
      expect((made.rotationStdDeg[i] ?? 0) * (Math.PI / 180)).toBeCloseTo(Math.sqrt(expected[i]?.[i] ?? 0), 4);
      expect(made.translationStdM[i]).toBeCloseTo(Math.sqrt(expected[3 + i]?.[3 + i] ?? 0), 4);
    });
  });

  // Fails when roll and yaw are exchanged.
  it("reads roll, pitch and yaw back", () => {
    const deg = Math.PI / 180;
    const made = product(product(turned([0, 0, 30 * deg]), turned([0, -20 * deg, 0])), turned([10 * deg, 0, 0]));
    eulerDeg(made).forEach((value, i) => expect(value).toBeCloseTo([10, -20, 30][i] ?? 0, 9));
  });
});

describe("the turn from one answer to the next", () => {
  // Fails when angles are subtracted, when the turn is told about the IMU's axes, or when half a turn is gone round the long way.
  it("is about the lidar's axes", () => {
    const deg = Math.PI / 180;
    const wanted = [
      [0.1, -0.2, 0.3],
      [20, 60, -100],
      [0, 0, 0],
    ];
    for (const from of [turned([1.5, 0.1, -0.2]), turned([0.1, 1.52, 0]), turned([0.2, 0.1, 3.1])]) {
      for (const turn of wanted) {
        const to = product(from, turned(turn.map((part) => part * deg)));
        turnDeg(eulerDeg(from), eulerDeg(to)).forEach((value, i) => expect(value).toBeCloseTo(turn[i] ?? 0, 9));
      }
    }
  });
});
