/** The receiver's networks as ONNX graphs. Only this file imports onnxruntime-web. */

import * as ort from "onnxruntime-web/wasm";
import { type GraphName, GRAPHS } from "./graph-names";

const WEIGHTS = "receiver.safetensors"; // the name by which graphs refer to the weights

/** Files of a model: graphs, and the weights file that they refer to. */
export interface ModelFiles {
  weights: Uint8Array;
  graphs: Record<GraphName, Uint8Array>;
}

export type Tensors = Record<string, ort.Tensor>;

/** Set the WebAssembly module of the runtime, before any graph is loaded. */
export function setRuntime(wasm: Uint8Array): void {
  ort.env.wasm.wasmBinary = wasm.slice().buffer;
  ort.env.wasm.numThreads = 1; // several threads need headers that a static server does not send
  ort.env.logLevel = "error";
}

export class Graphs {
  private constructor(private readonly sessions: Map<string, ort.InferenceSession>) {}

  static async load({ weights, graphs }: ModelFiles): Promise<Graphs> {
    const sessions = new Map<string, ort.InferenceSession>();
    for (const name of GRAPHS) {
      const options: ort.InferenceSession.SessionOptions = {
        executionProviders: ["wasm"],
        graphOptimizationLevel: "disabled", // optimising takes longer than it saves
        externalData: [{ path: WEIGHTS, data: weights }],
      };
      sessions.set(name, await ort.InferenceSession.create(graphs[name], options));
    }
    return new Graphs(sessions);
  }

  /** Run a graph; returns its outputs by name. */
  async run(name: GraphName, inputs: Tensors): Promise<Tensors> {
    const session = this.session(name);
    const feeds = Object.fromEntries(session.inputNames.map((input) => [input, inputs[input]]));
    return (await session.run(feeds)) as Tensors;
  }

  /** Return a size of an input that is the same for all streams. */
  fixedSize(name: GraphName, input: string, axis: number): number {
    const of = this.session(name).inputMetadata.find((metadata) => metadata.name === input);
    const size = of?.isTensor ? of.shape.at(axis) : undefined;
    if (typeof size !== "number") throw new Error(`graph ${name}: the input ${input} has no fixed size on axis ${axis}.`);
    return size;
  }

  private session(name: GraphName): ort.InferenceSession {
    const session = this.sessions.get(name);
    if (!session) throw new Error(`the graph ${name} was not loaded.`);
    return session;
  }
}

export function scalar(value: number): ort.Tensor {
  return integers(Int32Array.of(value), []);
}

export function integers(values: Int32Array, shape: readonly number[]): ort.Tensor {
  return new ort.Tensor("int32", values, shape);
}

export function floats(values: Float32Array, shape: readonly number[]): ort.Tensor {
  return new ort.Tensor("float32", values, shape);
}

export function zeros(...shape: number[]): ort.Tensor {
  return floats(new Float32Array(shape.reduce((size, side) => size * side)), shape);
}

export function floatsOf(tensor: ort.Tensor): Float32Array {
  return tensor.data as Float32Array;
}
