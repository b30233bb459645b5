/** Decoding of a stream to Gaussians, stage by stage. */

import { detailValues } from "./coding/detail-decoder";
import type { Field } from "./coding/field";
import { type PriorModel, readPriorModel } from "./coding/prior-model";
import { decodeStage } from "./coding/stage-decoder";
import { lambdaOfStage } from "./container/header";
import type { Stream } from "./container/stream";
import { readTables, type Table } from "./entropy/tables";
import { emit } from "./receiver/emission";
import type { Gaussians } from "./receiver/gaussians";
import { type ModelFiles, setRuntime } from "./receiver/graphs";
import { Networks, type State } from "./receiver/networks";
import { normalise } from "./receiver/normalised-cameras";

/** Duration of a step of decoding in milliseconds. */
export interface Timing {
  step: string;
  ms: number;
}

export interface StageResult {
  stage: number;
  /** In the frame and unit of length of the stored cameras. */
  gaussians: Gaussians;
  timings: Timing[];
}

/** Decoder of the streams of one model. */
export class Decoder {
  private constructor(
    private readonly tables: Table[],
    private readonly prior: PriorModel,
    private readonly networks: Networks,
  ) {}

  /** wasm: the file ort-wasm-simd-threaded.wasm. tables: the file symbol_tables.bin. */
  static async load(wasm: Uint8Array, tables: Uint8Array, model: ModelFiles): Promise<Decoder> {
    setRuntime(wasm);
    return new Decoder(readTables(tables), readPriorModel(model.weights), await Networks.load(model));
  }

  /**
   * Yield the scene after each stage of a stream, the last one final.
   *
   * The caller must ensure that the decoder has the stream's model. Throws Refusal for a damaged payload.
   */
  async *stages(stream: Stream): AsyncGenerator<StageResult> {
    const { header } = stream;
    const cameras = normalise(stream.cameras);
    const size16 = [header.views, header.gridHeight / 16, header.gridWidth / 16] as const;
    let state: State | null = null;
    let before: Field | null = null;
    for (let stage = 1; stage <= stream.payloads.length; stage++) {
      const clock = new Clock();
      const latents = decodeStage(stream, stage, before, this.prior, this.tables);
      before = latents.yHat;
      const isLast = stage === stream.payloads.length;
      const detail = detailValues(isLast ? stream.detail : null, header, this.prior, this.tables);
      clock.lap("symbols");
      state = await this.networks.update(latents.steps, size16, state, lambdaOfStage(header, stage), stage);
      clock.lap("state");
      const { prediction, times } = await this.networks.predict(state, detail, cameras);
      clock.laps(times);
      const gaussians = emit(prediction.gaussians, prediction.plain, cameras, stream);
      clock.lap("background");
      yield { stage, gaussians, timings: clock.timings };
    }
  }
}

class Clock {
  readonly timings: Timing[] = [];
  private last = performance.now();

  /** Record the time since the last call. */
  lap(step: string): void {
    const now = performance.now();
    this.timings.push({ step, ms: now - this.last });
    this.last = now;
  }

  /** Record times that were measured elsewhere, of what happened since the last call. */
  laps(times: Record<string, number>): void {
    for (const [step, ms] of Object.entries(times)) this.timings.push({ step, ms });
    this.last = performance.now();
  }
}
