/** The receiver's networks: update of the state and prediction of Gaussians, with the loops over views between graphs. */

import { type Gaussians, SH_DEGREE_0 } from "./gaussians";
import { floats, floatsOf, Graphs, integers, type ModelFiles, scalar, type Tensors, zeros } from "./graphs";
import { nearestNeighbours } from "./neighbours";
import type { NormalisedCameras } from "./normalised-cameras";
import { runOverPairs } from "./view-pairs";

const POINTS_AT_ONCE = 4096; // points per block of attention, so that gathered keys and values take little memory

/** The state of all views after a stage, with the condition of that stage: inputs of the graph `points`. */
export type State = Tensors;

/** Gaussians in the normalised frame, before culling; plain: harmonics of degree 0 of each, [n, 3]. */
export interface Prediction {
  gaussians: Gaussians;
  plain: Float32Array;
}

/** Milliseconds by step. */
export type PredictionTimes = Record<"points" | "neighbours" | "attention" | "attributes" | "views", number>;

export class Networks {
  private constructor(private readonly graphs: Graphs) {}

  static async load(model: ModelFiles): Promise<Networks> {
    return new Networks(await Graphs.load(model));
  }

  /**
   * Return the state after stage 1 or 2.
   *
   * steps: values of y in Q8, [4, views, rows, columns, channels] each. before: null in stage 1.
   */
  async update(
    steps: Int32Array[],
    [views, rows, columns]: readonly [number, number, number],
    before: State | null,
    lambdaQ: number,
    stage: number,
  ): Promise<State> {
    const channels = steps[0].length / (4 * views * rows * columns);
    const condition = { lambda_q: scalar(lambdaQ), stage: scalar(stage) };
    const anyState = () => zeros(views, this.graphs.fixedSize("update", "state", 1), 4 * rows, 4 * columns);
    const values = steps.map((step, at) => [`step_${at}`, integers(step, [4, views, rows, columns, channels])]);
    const inputs = { ...condition, state: before?.state ?? anyState(), ...Object.fromEntries(values) };
    const { state_after } = await this.graphs.run("update", inputs);
    return { ...condition, state: state_after };
  }

  /**
   * Predict the Gaussians of a state, ordered (view, row, column) on the 1/2 grid.
   *
   * detail: values that correct them, [view, plane, row, column] on the 1/8 grid. A model without detail has no planes,
   * and its graph has no such input.
   */
  async predict(
    state: State,
    detail: Float32Array,
    cameras: NormalisedCameras,
  ): Promise<{ prediction: Prediction; times: PredictionTimes }> {
    const poses = cameraTensors(cameras);
    const marks = [performance.now()];
    const mark = () => marks.push(performance.now());
    const found = { ...(await this.graphs.run("points", { ...state, ...poses })), ...poses };
    mark();
    const count = this.graphs.fixedSize("attend", "neighbours", -1);
    const neighbours = nearestNeighbours(floatsOf(found.points), count);
    mark();
    const attended = await this.attend(found, neighbours, count);
    mark();
    const maps = await this.graphs.run("attributes", { ...found, attended, detail: detailTensor(detail, found.depth.dims) });
    mark();
    const { positions, colours, surfaces } = maps;
    const { extrinsics, intrinsics } = poses;
    const ofViews = { positions, colours, surface: surfaces, extrinsics, intrinsics };
    const opacities = await this.faded(maps.opacities, ofViews);
    const prediction = predictionOf(maps, opacities, await this.fittedHarmonics(ofViews));
    mark();
    const [points, search, attention, attributes, views] = marks.slice(1).map((time, at) => time - marks[at]);
    return { prediction, times: { points, neighbours: search, attention, attributes, views } };
  }

  /** Return the residual of attention of each point to its neighbours, computed in blocks of points. */
  private async attend(found: Tensors, neighbours: Int32Array, count: number) {
    const numPoints = neighbours.length / count;
    const blocks: Float32Array[] = [];
    for (let first = 0; first < numPoints; first += POINTS_AT_ONCE) {
      const end = Math.min(first + POINTS_AT_ONCE, numPoints);
      const asking = Int32Array.from({ length: end - first }, (_, at) => first + at);
      const ofBlock = integers(neighbours.slice(first * count, end * count), [end - first, count]);
      const inputs = { ...found, asking: integers(asking, [end - first]), neighbours: ofBlock };
      blocks.push(floatsOf((await this.graphs.run("attend", inputs)).attended));
    }
    const channels = blocks.reduce((size, { length }) => size + length, 0) / numPoints;
    const attended = new Float32Array(numPoints * channels);
    blocks.forEach((block, at) => attended.set(block, at * POINTS_AT_ONCE * channels));
    return floats(attended, [...found.depth.dims, channels]);
  }

  /** Return the strongest free-space violation of each Gaussian. */
  private async violation(ofViews: Tensors): Promise<Float32Array> {
    const [views, , height, width] = ofViews.positions.dims;
    let sums: Tensors = { confirmed: zeros(views, height, width), violation: zeros(views, height, width) };
    let share = new Float32Array(views).fill(1);
    if (views > 2) {
      sums = await runOverPairs(this.graphs, "confirm", ofViews, sums);
      share = meansOfViews(floatsOf(sums.confirmed), views);
    }
    const judged = { ...ofViews, confirmed: sums.confirmed, share: floats(share, [views]) };
    const { violation } = await runOverPairs(this.graphs, "free_space", judged, { violation: sums.violation });
    return floatsOf(violation);
  }

  /** Return opacities after the free-space check, faded where another view shows the same surface more finely. */
  private async faded(opacities: Tensors[string], ofViews: Tensors): Promise<Float32Array> {
    const violation = await this.violation(ofViews);
    // The sigmoid of onnxruntime can be the next float32 after 1.
    const checked = floatsOf(opacities).map((opacity, at) => Math.min(1, opacity * (1 - violation[at])));
    if (opacities.dims[0] < 3) return checked;
    const judged = { ...ofViews, opacities: floats(checked, opacities.dims) };
    const ones = floats(new Float32Array(checked.length).fill(1), opacities.dims);
    const shares = floatsOf((await runOverPairs(this.graphs, "duplicates", judged, { kept: ones })).kept);
    return checked.map((opacity, at) => opacity * shares[at]);
  }

  /** Return harmonics of degree 1, fitted to the colours of other views; null for one view. */
  private async fittedHarmonics(ofViews: Tensors): Promise<Float32Array | null> {
    const [views, , height, width] = ofViews.positions.dims;
    if (views === 1) return null;
    const start = { matrix: zeros(views, 3, 3, height, width), right: zeros(views, 3, 3, height, width) };
    const equations = await runOverPairs(this.graphs, "slope", ofViews, start);
    return floatsOf((await this.graphs.run("harmonics", { ...ofViews, ...equations })).harmonics);
  }
}

function cameraTensors({ views, far }: NormalisedCameras): Tensors {
  const extrinsics = views.flatMap(({ rotation: r, centre: c }) => [
    ...[...r.slice(0, 3), c[0], ...r.slice(3, 6), c[1], ...r.slice(6, 9), c[2]],
    ...[0, 0, 0, 1],
  ]);
  const intrinsics = views.flatMap(({ fx, fy, cx, cy }) => [fx, 0, cx, 0, fy, cy, 0, 0, 1]);
  return {
    extrinsics: floats(Float32Array.from(extrinsics), [views.length, 4, 4]),
    intrinsics: floats(Float32Array.from(intrinsics), [views.length, 3, 3]),
    far: floats(Float32Array.of(far), []),
  };
}

function detailTensor(values: Float32Array, [views, rows, columns]: readonly number[]) {
  return floats(values, [views, values.length / (views * rows * columns), rows, columns]);
}

function meansOfViews(values: Float32Array, views: number) {
  const size = values.length / views;
  return Float32Array.from({ length: views }, (_, view) => {
    return values.subarray(view * size, (view + 1) * size).reduce((sum, value) => sum + value, 0) / size;
  });
}

function predictionOf(maps: Tensors, opacities: Float32Array, harmonics: Float32Array | null): Prediction {
  const colours = channelsLast(floatsOf(maps.colours), maps.opacities.dims[0]);
  const plain = colours.map((colour) => Math.fround(colour - 0.5) / SH_DEGREE_0);
  return {
    plain,
    gaussians: {
      count: opacities.length,
      numHarmonics: harmonics ? 4 : 1,
      means: channelsLast(floatsOf(maps.positions), maps.opacities.dims[0]),
      scales: floatsOf(maps.scales),
      rotations: floatsOf(maps.rotations),
      opacities,
      harmonics: harmonics ?? plain,
    },
  };
}

/** Reorder values [views, 3, pixels] to [views, pixels, 3]. */
function channelsLast(values: Float32Array, views: number): Float32Array {
  const pixels = values.length / (3 * views);
  const result = new Float32Array(values.length);
  for (let view = 0; view < views; view++) {
    for (let channel = 0; channel < 3; channel++) {
      const from = (3 * view + channel) * pixels;
      for (let at = 0; at < pixels; at++) result[3 * (view * pixels + at) + channel] = values[from + at];
    }
  }
  return result;
}
