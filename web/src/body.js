// The surface of a scene: triangles, or a disc for every point.
import {
  BufferAttribute, BufferGeometry, CircleGeometry, Color, DoubleSide, InstancedMesh, Matrix4, Mesh, MeshPhongMaterial,
  Quaternion, SRGBColorSpace, Vector3,
} from "three";
import { toCreasedNormals } from "three/addons/utils/BufferGeometryUtils.js";

const STEPS = 65535;
const CREASE = 0.7; // radians; sharper edges are not smoothed
const UNKNOWN = -128;
const [BLUE, WHITE, RED, GRAY] = [[33, 102, 172], [247, 247, 247], [178, 24, 43], [205, 208, 214]];

export class Body {
  constructor(scene, world) {
    const { positions, values, normals, faces } = scene.arrays;
    this.scene = scene;
    this.world = world;
    const extent = [0, 0, 0];
    for (let i = 0; i < positions.length; i++) extent[i % 3] = Math.max(extent[i % 3], positions[i]);
    this.half = extent.map((top) => top / STEPS / 2);
    this.radius = Math.hypot(...this.half) || 1;
    const places = Float32Array.from(positions, (step, i) => step / STEPS - this.half[i % 3]);
    const material = { side: DoubleSide, shininess: 18, specular: 0x2a2a2a };
    this.object = faces
      ? surface(places, faces, colors(values), material)
      : discs(places, normals, colors(values), material);
    this.material = this.object.material;
    world.add(this.object);
  }

  // A coordinate of the shape in the view, and back.
  place(x, axis) {
    return (x - this.scene.low[axis]) / this.scene.size - this.half[axis];
  }

  length(x, axis) {
    return (x + this.half[axis]) * this.scene.size + this.scene.low[axis];
  }

  setTransparent(wanted) {
    this.material.transparent = wanted;
    this.material.opacity = wanted ? 0.32 : 1;
    this.material.depthWrite = !wanted;
    this.material.needsUpdate = true;
  }

  toggleColors() {
    const object = this.object;
    if (object.isInstancedMesh) {
      [object.instanceColor, object.spare] = [object.spare ?? null, object.instanceColor];
    } else this.material.vertexColors = !this.material.vertexColors;
    this.material.color.set(object.instanceColor || this.material.vertexColors ? 0xffffff : 0xc8d0da);
    this.material.needsUpdate = true;
    return Boolean(object.instanceColor || this.material.vertexColors);
  }

  remove() {
    this.world.remove(this.object);
    this.object.geometry.dispose();
    this.material.dispose();
  }
}

function colors(values) {
  const found = new Float32Array(3 * values.length);
  const color = new Color();
  values.forEach((value, i) => {
    const share = Math.abs(value) / 127;
    const end = value < 0 ? BLUE : RED;
    const [r, g, b] = value === UNKNOWN ? GRAY : WHITE.map((w, channel) => w + share * (end[channel] - w));
    color.setRGB(r / 255, g / 255, b / 255, SRGBColorSpace).toArray(found, 3 * i);
  });
  return found;
}

function surface(places, faces, tints, look) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(places, 3));
  geometry.setAttribute("color", new BufferAttribute(tints, 3));
  geometry.setIndex(new BufferAttribute(faces, 1));
  return new Mesh(toCreasedNormals(geometry, CREASE), new MeshPhongMaterial({ ...look, vertexColors: true }));
}

function discs(places, normals, tints, look) {
  const count = places.length / 3;
  const object = new InstancedMesh(new CircleGeometry(spacing(places), 10), new MeshPhongMaterial(look), count);
  const [ahead, normal, turn] = [new Vector3(0, 0, 1), new Vector3(), new Quaternion()];
  const [position, one, matrix, color] = [new Vector3(), new Vector3(1, 1, 1), new Matrix4(), new Color()];
  for (let i = 0; i < count; i++) {
    turn.setFromUnitVectors(ahead, normal.fromArray(normals, 3 * i).normalize());
    object.setMatrixAt(i, matrix.compose(position.fromArray(places, 3 * i), turn, one));
    object.setColorAt(i, color.fromArray(tints, 3 * i));
  }
  return object;
}

// A radius at which most discs meet: the median distance to the fourth neighbor, of some points to all.
function spacing(places) {
  const count = places.length / 3;
  const probes = Array.from({ length: Math.min(60, count) }, (_, i) => Math.floor((i * count) / 60) % count);
  const found = probes.map((probe) => {
    const nearest = [Infinity, Infinity, Infinity, Infinity];
    for (let i = 0; i < count; i++) {
      if (i === probe) continue;
      const d = [0, 1, 2].reduce((sum, axis) => sum + (places[3 * i + axis] - places[3 * probe + axis]) ** 2, 0);
      if (d < nearest[3]) {
        nearest[3] = d;
        nearest.sort((a, b) => a - b);
      }
    }
    return Math.sqrt(nearest[3]);
  });
  const middle = found.sort((a, b) => a - b)[Math.floor(found.length / 2)];
  return Number.isFinite(middle) && middle > 0 ? 0.8 * middle : 0.01;
}
