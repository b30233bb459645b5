/** The receiver's networks as ONNX graphs. Only this file imports onnxruntime-web. */

import * as ort from "onnxruntime-web/wasm";
import type { Gaussians } from "./gaussians";
import { nearestNeighbours } from "./neighbours";
import type { NormalisedCameras } from "./normalised-cameras";

const WEIGHTS = "receiver.safetensors"; // the name by which graphs refer to the weights

/** Files of a model: graphs, and the weights file that they refer to. */
export interface ModelFiles {
  weights: Uint8Array;
  update: Uint8Array;
  points: Uint8Array;
  predict: Uint8Array;
}

/** The state of all views after a stage, with the condition of that stage. */
export interface State {
  state: ort.Tensor;
  lambdaQ: ort.Tensor;
  stage: ort.Tensor;
}

/** Gaussians in the normalised frame, before culling; plain: harmonics of degree 0 of each, [n, 3]. */
export interface Prediction {
  gaussians: Gaussians;
  plain: Float32Array;
}

export interface PredictionTimes {
  points: number;
  neighbours: number;
  predict: number;
}

/** Set the WebAssembly module of the runtime, before any network is loaded. */
export function setRuntime(wasm: Uint8Array): void {
  ort.env.wasm.wasmBinary = wasm.slice().buffer;
  ort.env.wasm.numThreads = 1; // several threads need headers that a static server does not send
  ort.env.logLevel = "error";
}

export class Networks {
  private constructor(
    private readonly updateGraph: ort.InferenceSession,
    private readonly pointsGraph: ort.InferenceSession,
    private readonly predictGraph: ort.InferenceSession,
  ) {}

  static async load({ weights, update, points, predict }: ModelFiles): Promise<Networks> {
    const options: ort.InferenceSession.SessionOptions = {
      executionProviders: ["wasm"],
      externalData: [{ path: WEIGHTS, data: weights }],
    };
    const sessions: ort.InferenceSession[] = [];
    for (const graph of [update, points, predict]) sessions.push(await ort.InferenceSession.create(graph, options));
    return new Networks(sessions[0], sessions[1], sessions[2]);
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
    const feeds: Record<string, ort.Tensor> = { ...condition, state: before?.state ?? this.anyState(views, rows, columns) };
    steps.forEach((values, at) => {
      feeds[`step_${at}`] = new ort.Tensor("int32", values, [4, views, rows, columns, channels]);
    });
    const { state_after } = await this.updateGraph.run(feeds);
    return { state: state_after, lambdaQ: condition.lambda_q, stage: condition.stage };
  }

  /** Predict the Gaussians of a state, ordered (view, row, column) on the 1/2 grid. */
  async predict(
    { state, lambdaQ, stage }: State,
    cameras: NormalisedCameras,
  ): Promise<{ prediction: Prediction; times: PredictionTimes }> {
    const views = cameraTensors(cameras);
    const start = performance.now();
    const found = await this.pointsGraph.run({ state, lambda_q: lambdaQ, stage, ...views });
    const searched = performance.now();
    const count = neighbourCount(this.predictGraph);
    const neighbours = nearestNeighbours(found.points.data as Float32Array, count);
    const predicting = performance.now();
    const of = await this.predictGraph.run({
      ...found,
      neighbours: new ort.Tensor("int32", neighbours, [...found.points.dims.slice(0, -1), count]),
      ...views,
    });
    const times = {
      points: searched - start,
      neighbours: predicting - searched,
      predict: performance.now() - predicting,
    };
    return { prediction: predictionOf(of, cameras.views.length), times };
  }

  /** Return a state of zeros: the graph takes one in stage 1, too, and ignores it. */
  private anyState(views: number, rows: number, columns: number): ort.Tensor {
    const channels = fixedSize(this.updateGraph, "state", 1);
    const shape = [views, channels, 4 * rows, 4 * columns];
    return new ort.Tensor("float32", new Float32Array(shape.reduce((size, side) => size * side)), shape);
  }
}

function scalar(value: number): ort.Tensor {
  return new ort.Tensor("int32", Int32Array.of(value), []);
}

function cameraTensors({ views, far }: NormalisedCameras): Record<string, ort.Tensor> {
  const extrinsics = views.flatMap(({ rotation: r, centre: c }) => [
    ...[...r.slice(0, 3), c[0], ...r.slice(3, 6), c[1], ...r.slice(6, 9), c[2]],
    ...[0, 0, 0, 1],
  ]);
  const intrinsics = views.flatMap(({ fx, fy, cx, cy }) => [fx, 0, cx, 0, fy, cy, 0, 0, 1]);
  return {
    extrinsics: new ort.Tensor("float32", Float32Array.from(extrinsics), [views.length, 4, 4]),
    intrinsics: new ort.Tensor("float32", Float32Array.from(intrinsics), [views.length, 3, 3]),
    far: new ort.Tensor("float32", Float32Array.of(far), []),
  };
}

function predictionOf(of: ort.InferenceSession.ReturnType, views: number): Prediction {
  const data = (name: string) => of[name].data as Float32Array;
  const [count] = of.opacities.dims;
  const hasOtherViews = views > 1; // colours by direction are fitted to the colours of other views
  return {
    gaussians: {
      count,
      numHarmonics: hasOtherViews ? 4 : 1,
      means: data("means"),
      scales: data("scales"),
      rotations: data("rotations"),
      opacities: data("opacities"),
      harmonics: data(hasOtherViews ? "harmonics" : "colours"),
    },
    plain: data("colours"),
  };
}

function neighbourCount(graph: ort.InferenceSession): number {
  return fixedSize(graph, "neighbours", -1);
}

/** Return a size of an input that is the same for all streams. */
function fixedSize(graph: ort.InferenceSession, input: string, axis: number): number {
  const of = graph.inputMetadata.find(({ name }) => name === input);
  const size = of?.isTensor ? of.shape.at(axis) : undefined;
  if (typeof size !== "number") throw new Error(`graph: the input ${input} has no fixed size on axis ${axis}.`);
  return size;
}
