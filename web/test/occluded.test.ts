/** The occluded part of the background layer: Gaussians behind near surfaces. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { readStream } from "../src/container/stream";
import { backgroundLayer } from "../src/receiver/background";
import { emit } from "../src/receiver/emission";
import { type Gaussians, meanOf, SH_DEGREE_0 } from "../src/receiver/gaussians";
import {
  type NormalisedCamera,
  type NormalisedCameras,
  normalise,
  toCamera,
  toImage,
} from "../src/receiver/normalised-cameras";
import { occludedLayer } from "../src/receiver/occluded";
import { type Place, type Point, surfaceGaussians } from "./surface-gaussians";

const GRID: [number, number] = [64, 96];
const [SQUARE, WALL] = [3, 8]; // depths
const HALF = 0.25; // of a side of the square
const [RED, GREEN] = [[0.9, 0.1, 0.1], [0.1, 0.9, 0.1]];

/** Return a camera that looks along z. */
function cameraAt(x: number, y: number, z: number): NormalisedCamera {
  return { rotation: [1, 0, 0, 0, 1, 0, 0, 0, 1], centre: [x, y, z], fx: 1, fy: 1.5, cx: 0.5, cy: 0.5 };
}

function inFrame(...views: NormalisedCamera[]): NormalisedCameras {
  return { views, far: 50, origin: [0, 0, 0], scale: 1 };
}

/** A red square before a green wall. */
function squareBeforeWall({ u, v }: Place): Point {
  const isNear = Math.max(Math.abs(u - 0.5), Math.abs(v - 0.5)) < HALF;
  return isNear ? { depth: SQUARE, opacity: 0.9, colour: RED } : { depth: WALL, opacity: 0.9, colour: GREEN };
}

/** Return the layer, and the positions of its Gaussians in the first view. */
function layerOf(cameras: NormalisedCameras, pointAt: (place: Place) => Point) {
  const layer = occludedLayer(surfaceGaussians(cameras.views, GRID, pointAt), cameras, GRID);
  return { layer, positions: positionsIn(cameras.views[0], layer) };
}

function positionsIn(camera: NormalisedCamera, layer: Gaussians) {
  return Array.from({ length: layer.count }, (_, index) => {
    const [x, y, depth] = toCamera(camera, ...meanOf(layer, index));
    const [u, v] = toImage(camera, x, y, depth);
    const fromCentre = Math.max(Math.abs(u - 0.5), Math.abs(v - 0.5));
    return { index, u, v, depth, fromCentre, distance: Math.hypot(x, y, depth) };
  });
}

/** Return the cells in which Gaussians of a view lie. */
function cellsOf(positions: { u: number; v: number }[]): string[] {
  return positions.map(({ u, v }) => `${Math.floor((u * GRID[1]) / 4)},${Math.floor((v * GRID[0]) / 4)}`);
}

const CAMERA = cameraAt(0, 0, 0);

test("a far surface is continued behind the edge of a near one, and nowhere else", () => {
  const { layer, positions } = layerOf(inFrame(CAMERA), squareBeforeWall);
  const behindEdge = positions.filter(({ fromCentre }) => fromCentre > HALF - 0.1);
  assert.equal(behindEdge.length, 28, "cells in the second row from the edge; those in the first touch the wall");
  for (const { index, depth } of behindEdge) {
    assert.ok(Math.abs(depth / (1.03 * WALL) - 1) < 0.03, `${depth}`);
    const colour = [...layer.harmonics.subarray(3 * index, 3 * index + 3)].map((value) => 0.5 + SH_DEGREE_0 * value);
    colour.forEach((value, channel) => assert.ok(Math.abs(value - GREEN[channel]) < 0.02, `${colour}`));
  }
  assert.ok(positions.every(({ fromCentre }) => fromCentre < HALF));
  assert.ok(positions.every(({ depth }) => depth > 1.1 * SQUARE));
  assert.ok(layer.opacities.every((opacity) => opacity === Math.fround(0.95)));
});

test("its Gaussians fill cells and face the view", () => {
  const { layer, positions } = layerOf(inFrame(CAMERA), squareBeforeWall);
  const [width, height] = [4 / GRID[1], 4 / GRID[0] / 1.5];
  for (const { index, depth } of positions) {
    const wanted = [width, height, 0.3 * Math.min(width, height)].map((value) => 0.6 * value * depth);
    wanted.forEach((value, axis) => assert.ok(Math.abs(layer.scales[3 * index + axis] - value) < 1e-6));
    assert.deepEqual([...layer.rotations.subarray(4 * index, 4 * index + 4)], [1, 0, 0, 0]);
  }
  assert.equal(new Set(cellsOf(positions)).size, layer.count, "one in a cell");
});

test("there are none behind a surface at one depth", () => {
  assert.equal(layerOf(inFrame(CAMERA), () => ({ depth: WALL, opacity: 0.9 })).layer.count, 0);
});

for (const [name, depth, isEmpty] of [["before", 12, true], ["behind", 2, false]] as const) {
  test(`${isEmpty ? "none are" : "all are"} kept that lie ${name} what a second camera shows`, () => {
    const pointAt = (place: Place) => (place.view === 0 ? squareBeforeWall(place) : { depth, opacity: 0.9 });
    const found = layerOf(inFrame(CAMERA, cameraAt(0.5, 0, 0)), pointAt).layer;
    assert.deepEqual(found.count, isEmpty ? 0 : layerOf(inFrame(CAMERA), squareBeforeWall).layer.count);
  });
}

test("where another view shows the candidate of the first blur, that of the second one is kept", () => {
  const alone = layerOf(inFrame(CAMERA), squareBeforeWall).positions;
  const pointAt = (place: Place) => (place.view === 0 ? squareBeforeWall(place) : { depth: 6, opacity: 0.9 });
  const { positions } = layerOf(inFrame(CAMERA, CAMERA), pointAt);
  assert.ok(alone.some(({ depth }) => depth < 1.03 * 6), "or this test sees nothing");
  assert.ok(positions.every(({ depth }) => depth > 1.03 * 6));
  const shown = alone.filter(({ depth }) => depth < 1.03 * 6);
  const cells = new Set(cellsOf(positions));
  assert.ok(cellsOf(shown).some((cell) => cells.has(cell)));
  assert.equal(cells.size, positions.length, "one in a cell");
});

test("there are none near a camera", () => {
  const second = cameraAt(-HALF * WALL, 0, WALL);
  const pointAt = (place: Place) => (place.view === 0 ? squareBeforeWall(place) : { depth: 0.01, opacity: 0.9 });
  const { layer } = layerOf(inFrame(CAMERA, second), pointAt);
  const distances = positionsIn(second, layer).map(({ distance }) => distance);
  assert.ok(0 < layer.count && layer.count < layerOf(inFrame(CAMERA), squareBeforeWall).layer.count);
  assert.ok(Math.min(...distances) >= 1);
});

test("there are none where Gaussians around are not emitted", () => {
  const isHole = (u: number) => u < 0.5 && Math.floor(u * GRID[1]) % 4 === 1; // a column of each cell
  const pointAt = (place: Place) => ({ ...squareBeforeWall(place), ...(isHole(place.u) ? { opacity: 0 } : {}) });
  const { positions } = layerOf(inFrame(CAMERA), pointAt);
  assert.ok(positions.length > 20);
  assert.ok(positions.every(({ u }) => u > 0.5));
  const cutOut = (place: Place) => {
    const point = squareBeforeWall(place);
    return point.depth === WALL ? { ...point, opacity: 0 } : point;
  };
  assert.equal(layerOf(inFrame(CAMERA), cutOut).layer.count, 0);
});

test("a Gaussian that is not finite changes nothing else", () => {
  const gaussians = surfaceGaussians([CAMERA], GRID, squareBeforeWall);
  gaussians.opacities[0] = 0;
  const wanted = occludedLayer(gaussians, inFrame(CAMERA), GRID);
  gaussians.means.fill(NaN, 0, 3);
  assert.deepEqual(occludedLayer(gaussians, inFrame(CAMERA), GRID), wanted);
});

test("it comes last in a scene, with plain colours and from the Gaussians that are emitted", () => {
  const vector = join(process.cwd(), "..", "bitstream_spec", "vectors", "valid", "landscape.fcs"); // 2 views of 64x128
  const stream = readStream(new Uint8Array(readFileSync(vector)));
  const cameras = normalise(stream.cameras);
  const grid: [number, number] = [32, 64];
  const pointAt = (place: Place) => ({ ...squareBeforeWall(place), opacity: place.u < 0.5 ? 0.003 : 0.9 });
  const predicted = surfaceGaussians(cameras.views, grid, pointAt);
  const plain = predicted.harmonics;
  const scene = emit({ ...predicted, harmonics: plain.map((value) => 0.9 * value) }, plain, cameras, stream);
  const opacities = predicted.opacities.map((opacity) => (opacity < 0.5 ? 0 : opacity));
  const outside = backgroundLayer({ ...predicted, opacities }, cameras, grid);
  const occluded = occludedLayer({ ...predicted, opacities }, cameras, grid);
  assert.ok(occluded.count > 0);
  assert.equal(scene.count, predicted.count / 2 + outside.count + occluded.count);
  assert.deepEqual(scene.harmonics.slice(-3 * occluded.count), occluded.harmonics);
  const means = occluded.means.map((value, at) => value * cameras.scale + cameras.origin[at % 3]);
  assert.deepEqual(scene.means.slice(-3 * occluded.count), means);
});

test("a cut-out and more than eight views have none", () => {
  const vector = join(process.cwd(), "..", "bitstream_spec", "vectors", "valid", "landscape.fcs"); // 2 views of 64x128
  const stream = readStream(new Uint8Array(readFileSync(vector)));
  const grid: [number, number] = [32, 64];
  const [camera] = normalise(stream.cameras).views;
  const countOf = (numViews: number, coverage: Uint8Array | null) => {
    const views = Array.from({ length: numViews }, () => camera);
    const cameras = { ...normalise(stream.cameras), views };
    const scene = surfaceGaussians(views, grid, squareBeforeWall);
    const occluded = occludedLayer(scene, cameras, grid).count;
    const rest = scene.count + backgroundLayer(scene, cameras, grid).count;
    return { occluded, added: emit(scene, scene.harmonics, cameras, { ...stream, coverage }).count - rest };
  };
  const eight = countOf(8, null);
  assert.ok(eight.occluded > 0);
  assert.equal(eight.added, eight.occluded);
  assert.equal(countOf(9, null).added, 0);
  assert.equal(countOf(2, new Uint8Array((2 * 16 * 32) / 8).fill(255)).added, 0);
});
