/** Decoding of the latents of a stage from its payload (ENTROPY.md, section 7). */

import { AnsDecoder } from "../entropy/ans-decoder";
import { decodeBatch } from "../entropy/batch";
import type { Table } from "../entropy/tables";
import { AROUND, doubled, emptyField, type Field, HERE, Inputs, type Offsets, type Positions, positionsOf } from "./field";
import type { IntegerLayer } from "./integer-layer";
import { layerOf, type PriorModel } from "./prior-model";

const KNOWN_BLOCKS: Offsets[] = [
  [],
  [[-1, -1], [-1, 1], [1, -1], [1, 1]],
  [[-1, 0], [0, -1], [0, 1], [1, 0]],
];
const QUARTER_OF_STEP = [0, 3, 2, 1]; // XOR with the phase

export interface Latents {
  /** Symbols of the seven batches in coding order. */
  batches: Int32Array[];
  /** Dequantised values in Q8, not clipped. */
  zHat: Field;
  yHat: Field;
  /** Values of the four steps of y in Q8, [4 phases, view, row, column, quarter of the channels]. */
  steps: Int32Array[];
}

/** The state of decoding one payload: its decoder, its batches so far, the model. */
class Scan {
  readonly batches: Int32Array[] = [];
  readonly decoder: AnsDecoder;

  constructor(
    readonly model: PriorModel,
    private readonly tables: Table[],
    payload: Uint8Array,
  ) {
    this.decoder = new AnsDecoder(payload);
  }

  layer(name: string): IntegerLayer {
    return layerOf(this.model.layers, name);
  }

  /**
   * Decode a batch from rows of `channels` means and `channels` positions of tables. Returns its values
   * 256 symbol + mean, [row, channels].
   */
  values(parameters: Float64Array, channels: number): Float64Array {
    const count = parameters.length / 2;
    const indices = new Uint8Array(count);
    const means = new Float64Array(count);
    for (let element = 0; element < count; element++) {
      const row = Math.floor(element / channels);
      const at = 2 * channels * row + (element - channels * row);
      means[element] = parameters[at];
      indices[element] = tableIndex(parameters[at + channels]);
    }
    const symbols = decodeBatch(this.decoder, this.tables, indices);
    this.batches.push(symbols);
    return means.map((mean, element) => 256 * symbols[element] + mean);
  }
}

/**
 * Decode the latents of stage 1 or 2.
 *
 * size8: views, rows and columns of y. before: y_hat of stage 1 in stage 2, null in stage 1. Throws Refusal for a
 * payload that breaks a rule; the caller must compare the digest.
 */
export function decodeLatents(
  model: PriorModel,
  tables: Table[],
  payload: Uint8Array,
  size8: readonly [number, number, number],
  lambdaQ: number,
  stage: number,
  before: Field | null,
): Latents {
  const scan = new Scan(model, tables, payload);
  const condition = stage === 1 ? [256, 0, lambdaQ - 884, 0] : [0, 256, 0, lambdaQ - 884];
  const zHat = decodeHyper(scan, size8, condition);
  const features = featuresOf(scan, zHat, condition, before);
  const { yHat, steps } = decodeLatent(scan, features);
  scan.decoder.end();
  return { batches: scan.batches, zHat, yHat, steps };
}

function tableIndex(position: number): number {
  return Math.min(Math.max(22 + Math.floor((position + 16) / 32), 0), 63);
}

function everywhere(field: Field): Positions {
  return positionsOf(field.views, field.rows, field.columns, () => true);
}

function decodeHyper(scan: Scan, size8: readonly [number, number, number], condition: number[]): Field {
  const field = emptyField(size8[0], size8[1] / 4, size8[2] / 4, scan.model.hyper);
  const parameters = scan.layer("hyper_prior").apply(Float64Array.from(condition), 1, 0, -32768);
  const rows = field.views * field.rows * field.columns;
  const repeated = new Float64Array(rows * parameters.length);
  for (let row = 0; row < rows; row++) repeated.set(parameters, row * parameters.length);
  return { ...field, values: scan.values(repeated, field.channels) };
}

/** Apply a layer at every position of a field. */
function mapped(scan: Scan, name: string, field: Field, offsets: Offsets): Field {
  const layer = scan.layer(name);
  const positions = everywhere(field);
  const inputs = new Inputs(positions, offsets.length * field.channels).add(field, offsets);
  return { ...field, values: layer.apply(inputs.values, positions.count, 0, 0), channels: layer.outputs };
}

/** Return the features e at 1/8, from z_hat and y_hat of the stage before. */
function featuresOf(scan: Scan, zHat: Field, condition: number[], before: Field | null): Field {
  const { width, hyper, latent } = scan.model;
  const coarse = everywhere(zHat);
  const entered = new Inputs(coarse, 9 * hyper + 4).add(zHat, AROUND).addConstant(condition);
  const a = scan.layer("enter").apply(entered.values, coarse.count, 0, 0);
  const b = doubled(mapped(scan, "up_16", { ...zHat, values: a, channels: width }, HERE));
  const c = mapped(scan, "around_16", b, AROUND);
  const d = doubled(mapped(scan, "up_8", c, HERE));
  const positions = everywhere(d);
  const inputs = new Inputs(positions, width + 4 + (before ? 9 * latent : 0)).add(d, HERE).addConstant(condition);
  if (before) inputs.add(before, AROUND);
  return { ...d, values: scan.layer("merge_8").apply(inputs.values, positions.count, 0, 0), channels: width };
}

function decodeLatent(scan: Scan, features: Field): { yHat: Field; steps: Int32Array[] } {
  const quarter = scan.model.latent / 4;
  const { views, rows, columns } = features;
  const phases = [0, 1, 2, 3].map((m) => positionsOf(views, rows, columns, (i, j) => phaseOf(i, j) === m));
  const steps = [decodeFirstStep(scan, features)];
  const inOrder = [gathered(steps[0], phases)];
  for (let step = 1; step < 4; step++) {
    const parameters = phases.map((positions, phase) => {
      const inputs = new Inputs(positions, features.channels + 9 * quarter * step).add(features, HERE);
      steps.forEach((known) => inputs.add(known, AROUND));
      return threeLayers(scan, `steps.${step}`, inputs.values, positions.count, phase);
    });
    const values = scan.values(joined(parameters), quarter);
    steps.push(scattered(values, phases, emptyField(views, rows, columns, quarter)));
    inOrder.push(Int32Array.from(values));
  }
  return { yHat: quartersInPlace(steps, emptyField(views, rows, columns, scan.model.latent)), steps: inOrder };
}

/** Decode step 0, block by block in three passes; returns its values at every position. */
function decodeFirstStep(scan: Scan, features: Field): Field {
  const quarter = scan.model.latent / 4;
  const sums = blockSums(features);
  const known = { ...sums, values: new Float64Array((sums.values.length / sums.channels) * 4 * quarter), channels: 4 * quarter };
  for (let pass = 0; pass < 3; pass++) {
    const blocks = positionsOf(sums.views, sums.rows, sums.columns, (i, j) => passOf(i, j) === pass);
    const offsets = KNOWN_BLOCKS[pass];
    const inputs = new Inputs(blocks, sums.channels + offsets.length * known.channels).add(sums, HERE).add(known, offsets);
    const parameters = threeLayers(scan, `passes.${pass}`, inputs.values, blocks.count, 0);
    const values = scan.values(byPhase(parameters, blocks.count, 2 * quarter), quarter);
    for (let at = 0; at < 4 * blocks.count; at++) {
      const block = at % blocks.count;
      const to = (blocks.view[block] * known.rows + blocks.row[block]) * known.columns + blocks.column[block];
      const phase = Math.floor(at / blocks.count);
      known.values.set(values.subarray(at * quarter, (at + 1) * quarter), to * known.channels + phase * quarter);
    }
  }
  return doubled(known);
}

function phaseOf(row: number, column: number): number {
  return 2 * (row % 2) + (column % 2);
}

function passOf(row: number, column: number): number {
  return (row + column) % 2 ? 2 : row % 2;
}

/** Return the sums of the features over blocks of 2x2 positions. */
function blockSums(features: Field): Field {
  const sums = emptyField(features.views, features.rows / 2, features.columns / 2, features.channels);
  const { columns, channels } = features;
  for (let line = 0; line < features.views * features.rows; line++) {
    for (let column = 0; column < columns; column++) {
      const from = (line * columns + column) * channels;
      const to = ((line >> 1) * sums.columns + (column >> 1)) * channels;
      for (let c = 0; c < channels; c++) sums.values[to + c] += features.values[from + c];
    }
  }
  return sums; // not negative, so that clipping to int16 clips to 32767
}

/** Reorder [block, phase, value] to [phase, block, value]. */
function byPhase(parameters: Float64Array, blocks: number, size: number): Float64Array {
  const result = new Float64Array(parameters.length);
  for (let block = 0; block < blocks; block++) {
    for (let phase = 0; phase < 4; phase++) {
      const from = (4 * block + phase) * size;
      result.set(parameters.subarray(from, from + size), (phase * blocks + block) * size);
    }
  }
  return result;
}

function threeLayers(scan: Scan, name: string, x: Float64Array, rows: number, group: number): Float64Array {
  const entered = scan.layer(`${name}.enter`).apply(x, rows, group, 0);
  const middle = scan.layer(`${name}.middle`).apply(entered, rows, group, 0);
  return scan.layer(`${name}.leave`).apply(middle, rows, group, -32768);
}

function joined(parts: Float64Array[]): Float64Array {
  const result = new Float64Array(parts.reduce((size, part) => size + part.length, 0));
  let at = 0;
  for (const part of parts) {
    result.set(part, at);
    at += part.length;
  }
  return result;
}

/** Return the values of a field in the order of a batch, phase by phase. */
function gathered(field: Field, phases: Positions[]): Int32Array {
  return Int32Array.from(joined(phases.map((positions) => new Inputs(positions, field.channels).addExact(field).values)));
}

/** Write values in the order of a batch, phase by phase, to their positions. */
function scattered(values: Float64Array, phases: Positions[], field: Field): Field {
  let from = 0;
  for (const { count, view, row, column } of phases) {
    for (let position = 0; position < count; position++, from += field.channels) {
      const to = (view[position] * field.rows + row[position]) * field.columns + column[position];
      field.values.set(values.subarray(from, from + field.channels), to * field.channels);
    }
  }
  return field;
}

/** Write the values of each step to the quarter of the channels that the step codes at each position. */
function quartersInPlace(steps: Field[], yHat: Field): Field {
  const quarter = yHat.channels / 4;
  steps.forEach(({ values }, step) => {
    for (let position = 0; position < values.length / quarter; position++) {
      const column = position % yHat.columns;
      const row = Math.floor(position / yHat.columns) % yHat.rows;
      const to = position * yHat.channels + quarter * (phaseOf(row, column) ^ QUARTER_OF_STEP[step]);
      yHat.values.set(values.subarray(position * quarter, (position + 1) * quarter), to);
    }
  });
  return yHat;
}
