// Lines and dots that mark places, seen through the surface too; the chosen one is thick.
import { Box3, BufferAttribute, BufferGeometry, Points, PointsMaterial, Vector2, Vector3 } from "three";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";

const STEPS = 65535;
export const COLORS = {
  handle: 0xd66000, tunnel: 0x007850, boundary: 0x783ca0, defect: 0xc8003c, missing: 0x2166ac, spurious: 0xb2182b,
};

export class Marks {
  constructor(scene, world) {
    this.world = world;
    this.objects = [];
    this.chosen = [];
    this.resolution = new Vector2(1, 1);
    const half = [0, 0, 0];
    const { positions, marks } = scene.arrays;
    for (let i = 0; i < positions.length; i++) half[i % 3] = Math.max(half[i % 3], positions[i] / STEPS / 2);
    const all = Array.from(marks ?? [], (step, i) => step / STEPS - half[i % 3]);
    let start = 0;
    this.marks = scene.marks.map((mark) => {
      const points = all.slice(3 * start, 3 * (start + mark.points));
      start += mark.points;
      return { ...mark, points };
    });
    for (const kind of Object.keys(COLORS)) {
      const ofKind = this.marks.filter((mark) => mark.kind === kind);
      this.objects.push(...this.add(ofKind, COLORS[kind], 3));
    }
  }

  add(marks, color, width) {
    const segments = marks.flatMap((mark) => pairs(mark));
    const dots = marks.filter((mark) => mark.form === "dots").flatMap((mark) => mark.points);
    const made = [];
    for (const behind of [true, false]) {
      const look = { color, depthTest: !behind, transparent: behind, opacity: behind ? 0.3 : 1 };
      if (segments.length) {
        const geometry = new LineSegmentsGeometry().setPositions(segments);
        made.push(new LineSegments2(geometry, new LineMaterial({ ...look, linewidth: width })));
      }
      if (dots.length) {
        const geometry = new BufferGeometry();
        geometry.setAttribute("position", new BufferAttribute(Float32Array.from(dots), 3));
        made.push(new Points(geometry, new PointsMaterial({ ...look, size: 3 * width, sizeAttenuation: false })));
      }
    }
    for (const object of made) {
      object.renderOrder = object.material.depthTest ? 2 : 1;
      if (object.material.resolution) object.material.resolution.copy(this.resolution);
      this.world.add(object);
    }
    return made;
  }

  // Draws a mark thick, none for null; the box around it.
  choose(index) {
    for (const object of this.chosen) dispose(object, this.world);
    this.chosen = [];
    if (index === null) return null;
    const mark = this.marks[index];
    this.chosen = this.add([mark], COLORS[mark.kind], 7);
    for (const object of this.chosen) object.renderOrder += 2;
    const box = new Box3();
    for (let i = 0; i < mark.points.length; i += 3) box.expandByPoint(new Vector3(...mark.points.slice(i, i + 3)));
    return box;
  }

  resize(width, height) {
    this.resolution.set(width, height);
    for (const { material } of [...this.objects, ...this.chosen]) material.resolution?.copy(this.resolution);
  }

  remove() {
    for (const object of [...this.objects, ...this.chosen]) dispose(object, this.world);
  }
}

function dispose(object, world) {
  world.remove(object);
  object.geometry.dispose();
  object.material.dispose();
}

// The segments of a curve, six numbers each.
function pairs({ points, form }) {
  const count = points.length / 3;
  const last = form === "dots" ? 0 : form === "loop" ? count : count - 1;
  return Array.from({ length: last }, (_, i) => [i, (i + 1) % count])
    .flat()
    .flatMap((i) => points.slice(3 * i, 3 * i + 3));
}
