// The picture of a mesh and its points. It is drawn when something changed, not all the time.

import {
  BufferAttribute, BufferGeometry, CanvasTexture, Color, DirectionalLight, DoubleSide, HemisphereLight, Line, LineBasicMaterial, Mesh as Triangles,
  MeshPhongMaterial, PerspectiveCamera, Plane, Points as Dots, PointsMaterial, Raycaster, Scene as World, SRGBColorSpace,
  Vector2, Vector3, WebGLRenderer, type Intersection, type Object3D,
} from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import type { Frame } from '../api/types';
import { cividis } from './colormap';
import { direction as from, Letters } from './letters';
import type { Mesh, Points } from './ply';

export type Triple = [number, number, number];

export interface Look {
  mesh: boolean;
  points: boolean;
  wireframe: boolean;
  color: '' | 'points' | 'other';
  /** Distance that has the last colour. */
  most: number;
  /** Axis of the plane that cuts the picture open. */
  cut: '' | 'x' | 'y' | 'z';
  /** Where it is, from one end, 0, to the other, 1. */
  cutAt: number;
}

export interface Palette {
  background: string;
  surface: string;
  points: string;
  inside: string;
  outside: string;
  pick: string;
  letters: string;
}

export type Direction = 'front' | 'back' | 'left' | 'right' | 'top' | 'bottom' | 'corner';

/** A click that moved further, in pixels, turned the picture. */
const CLICK = 4;

/** Makes points round. */
function disc(): CanvasTexture {
  const canvas = document.createElement('canvas');
  canvas.width = canvas.height = 32;
  const context = canvas.getContext('2d');
  if (context) {
    context.fillStyle = '#fff';
    context.arc(16, 16, 15, 0, 2 * Math.PI);
    context.fill();
  }
  return new CanvasTexture(canvas);
}

/** Angle of a step of the arrow keys. */
const STEP = Math.PI / 18;

export class Scene {
  onPick: (picks: Triple[]) => void = () => {};
  onTurn: (position: Vector3, target: Vector3) => void = () => {};
  onLost: (lost: boolean) => void = () => {};

  private readonly renderer = new WebGLRenderer({ antialias: true });
  private readonly world = new World();
  private readonly camera = new PerspectiveCamera(35, 1, 0.01, 100);
  private readonly controls: OrbitControls;
  private readonly resize: ResizeObserver;
  private readonly plane = new Plane(new Vector3(-1, 0, 0), 0);
  private readonly round = disc();
  private readonly surface = new Triangles(new BufferGeometry(), new MeshPhongMaterial({ side: DoubleSide, shininess: 18, specular: 0x222222 }));
  private readonly dots = new Dots(new BufferGeometry(), new PointsMaterial({ size: 4, sizeAttenuation: false, vertexColors: true, map: this.round, alphaTest: 0.5 }));
  private readonly marks = new Dots(new BufferGeometry(), new PointsMaterial({ size: 12, sizeAttenuation: false, depthTest: false, map: this.round, alphaTest: 0.5 }));
  private readonly tape = new Line(new BufferGeometry(), new LineBasicMaterial({ depthTest: false }));
  private readonly letters = new Letters();
  private frame: Frame | null = null;
  private origin: Triple | null;
  private picks: Vector3[] = [];
  private low = new Vector3(-1, -1, -1);
  private high = new Vector3(1, 1, 1);
  private mesh: Mesh | null = null;
  private points: Points | null = null;
  private look: Look | null = null;
  private palette: Palette | null = null;
  private framed = false;
  private pending = 0;
  private press = new Vector2();

  constructor(private readonly container: HTMLElement, origin: Triple | null = null) {
    this.origin = origin;
    const canvas = this.renderer.domElement;
    canvas.setAttribute('aria-hidden', 'true');
    container.append(canvas);
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.localClippingEnabled = true;
    this.camera.up.set(0, 0, 1);
    const lamp = new DirectionalLight(0xffffff, 2.2);
    lamp.position.set(0.4, 0.6, 1);
    this.camera.add(lamp);
    this.tape.renderOrder = 1;
    this.marks.renderOrder = 2;
    this.surface.visible = false;
    this.world.add(this.camera, new HemisphereLight(0xffffff, 0x667788, 1.1), this.surface, this.dots, this.tape, this.marks, this.letters);
    this.controls = new OrbitControls(this.camera, canvas);
    // The wheel scrolls the page until the picture has the focus.
    this.controls.enableZoom = false;
    container.addEventListener('focusin', () => { this.controls.enableZoom = true; });
    container.addEventListener('focusout', () => { this.controls.enableZoom = false; });
    this.controls.addEventListener('change', () => {
      this.draw();
      this.onTurn(this.camera.position, this.controls.target);
    });
    canvas.addEventListener('pointerdown', ({ clientX, clientY }) => {
      container.focus({ preventScroll: true });
      this.press.set(clientX, clientY);
    });
    canvas.addEventListener('pointerup', ({ clientX, clientY, button }) => {
      if (button === 0 && this.press.distanceTo(new Vector2(clientX, clientY)) < CLICK) {
        const { left, top, width, height } = canvas.getBoundingClientRect();
        this.pick(((clientX - left) / width) * 2 - 1, 1 - ((clientY - top) / height) * 2);
      }
    });
    canvas.addEventListener('webglcontextlost', (event) => {
      event.preventDefault();
      this.onLost(true);
    });
    canvas.addEventListener('webglcontextrestored', () => {
      this.onLost(false);
      this.draw();
    });
    this.resize = new ResizeObserver(() => this.fit());
    this.resize.observe(container);
    this.fit();
  }

  setMesh(mesh: Mesh | null): void {
    this.mesh = mesh;
    this.surface.geometry.dispose();
    this.surface.geometry = new BufferGeometry();
    if (mesh) {
      this.surface.geometry.setAttribute('position', new BufferAttribute(mesh.positions, 3));
      this.surface.geometry.setIndex(new BufferAttribute(mesh.index, 1));
      if (mesh.normals) this.surface.geometry.setAttribute('normal', new BufferAttribute(mesh.normals, 3));
      else this.surface.geometry.computeVertexNormals();
      this.place(this.surface, mesh.origin);
    }
    this.changed();
  }

  setPoints(points: Points | null): void {
    this.points = points;
    this.dots.geometry.dispose();
    this.dots.geometry = new BufferGeometry();
    if (points) {
      this.dots.geometry.setAttribute('position', new BufferAttribute(points.positions, 3));
      this.place(this.dots, points.origin);
    }
    this.changed();
  }

  /** Says how the coordinates lie in a patient, if they do. */
  setFrame(frame: Frame | null): void {
    if (frame === this.frame) return;
    this.frame = frame;
    // The first picture was drawn from a side that may be another one now.
    this.framed = false;
    this.changed();
  }

  show(look: Look, palette: Palette): void {
    const before = this.look;
    const repaint = palette !== this.palette || before?.color !== look.color || before?.most !== look.most;
    this.look = look;
    this.palette = palette;
    if (repaint) this.paint();
    this.apply();
  }

  /** Looks at everything from there. */
  view(direction: Direction): void {
    const middle = this.low.clone().add(this.high).multiplyScalar(0.5);
    const radius = Math.max(this.low.distanceTo(this.high) / 2, 1e-12);
    const narrow = Math.min(1, this.camera.aspect);
    const distance = (radius / Math.sin((this.camera.fov * Math.PI) / 360) / narrow) * 0.82;
    this.camera.near = distance / 1000;
    this.camera.far = distance * 20;
    this.camera.updateProjectionMatrix();
    this.controls.target.copy(middle);
    this.camera.position.copy(middle).addScaledVector(new Vector3(...from(this.frame, direction)).normalize(), distance);
    this.controls.update();
    this.draw();
    this.onTurn(this.camera.position, this.controls.target);
  }

  /** Turns by steps to the right and up, as the arrow keys ask for. */
  turn(right: number, up: number): void {
    const arm = this.camera.position.clone().sub(this.controls.target);
    arm.applyAxisAngle(this.camera.up, right * STEP);
    const side = new Vector3().crossVectors(this.camera.up, arm).normalize();
    const angle = arm.angleTo(this.camera.up);
    const step = Math.min(Math.PI - 0.05 - angle, Math.max(0.05 - angle, -up * STEP));
    arm.applyAxisAngle(side, step);
    this.camera.position.copy(this.controls.target).add(arm);
    this.controls.update();
  }

  zoom(factor: number): void {
    this.camera.position.sub(this.controls.target).multiplyScalar(factor).add(this.controls.target);
    this.controls.update();
  }

  /** Takes the camera of another picture over. */
  follow(position: Vector3, target: Vector3): void {
    this.camera.position.copy(position);
    this.controls.target.copy(target);
    this.camera.lookAt(target);
    this.draw();
  }

  /** What is seen there, in the middle if nothing else is said, becomes a mark; the third begins anew. */
  pick(x = 0, y = 0): void {
    // It may have moved since it was drawn.
    this.camera.updateMatrixWorld();
    const caster = new Raycaster();
    caster.setFromCamera(new Vector2(x, y), this.camera);
    caster.params.Points.threshold = this.low.distanceTo(this.high) / 150;
    const shown = [this.surface, this.dots].filter((object) => object.visible && object.geometry.getAttribute('position'));
    const hits = caster.intersectObjects<Object3D>(shown, false).filter((hit) => this.kept(hit));
    const hit = hits[0]?.point;
    if (!hit) return;
    this.picks = this.picks.length >= 2 ? [hit] : [...this.picks, hit];
    this.mark();
  }

  clearPicks(): void {
    this.picks = [];
    this.mark();
  }

  picture(): Promise<Blob | null> {
    this.render();
    return new Promise((resolve) => this.renderer.domElement.toBlob(resolve, 'image/png'));
  }

  dispose(): void {
    cancelAnimationFrame(this.pending);
    this.resize.disconnect();
    this.controls.dispose();
    for (const object of [this.surface, this.dots, this.marks, this.tape]) {
      object.geometry.dispose();
      object.material.dispose();
    }
    this.letters.dispose();
    this.round.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.renderer.domElement.remove();
  }

  private place(object: Object3D, origin: Triple): void {
    this.origin ??= origin;
    object.position.set(origin[0] - this.origin[0], origin[1] - this.origin[1], origin[2] - this.origin[2]);
    object.updateMatrixWorld();
  }

  private changed(): void {
    this.low.setScalar(Infinity);
    this.high.setScalar(-Infinity);
    for (const object of [this.surface, this.dots]) {
      if (!object.geometry.getAttribute('position')?.count) continue;
      object.geometry.computeBoundingBox();
      const box = object.geometry.boundingBox;
      if (!box) continue;
      this.low.min(box.min.clone().add(object.position));
      this.high.max(box.max.clone().add(object.position));
    }
    if (this.low.x > this.high.x) {
      this.low.setScalar(-1);
      this.high.setScalar(1);
    } else if (!this.framed) {
      this.framed = true;
      this.view('corner');
    }
    this.paint();
    this.apply();
  }

  /** Gives vertices and points their colours. */
  private paint(): void {
    const { mesh, points, look, palette } = this;
    if (!look || !palette) return;
    const byDistance = look.color === 'points' ? mesh?.distances : look.color === 'other' ? mesh?.toOther : null;
    if (mesh && byDistance) {
      const colors = new Float32Array(mesh.positions.length);
      const color = new Color();
      byDistance.forEach((distance, i) => {
        color.setRGB(...cividis(distance / look.most), SRGBColorSpace).toArray(colors, 3 * i);
      });
      this.surface.geometry.setAttribute('color', new BufferAttribute(colors, 3));
    }
    this.surface.material.vertexColors = Boolean(byDistance);
    this.surface.material.color.set(byDistance ? 0xffffff : palette.surface);
    this.surface.material.needsUpdate = true;
    if (points) {
      const [on, inside, outside] = [palette.points, palette.inside, palette.outside].map((name) => new Color(name)) as [Color, Color, Color];
      const colors = new Float32Array(points.positions.length);
      points.labels.forEach((label, i) => (label > 0 ? inside : label < 0 ? outside : on).toArray(colors, 3 * i));
      this.dots.geometry.setAttribute('color', new BufferAttribute(colors, 3));
    }
    this.world.background = new Color(palette.background);
    this.marks.material.color.set(palette.pick);
    this.tape.material.color.set(palette.pick);
    this.letters.show(this.frame, [this.low, this.high], [palette.letters, palette.background]);
  }

  private apply(): void {
    const { look } = this;
    if (!look) return;
    this.surface.visible = look.mesh && this.mesh !== null;
    this.dots.visible = look.points && this.points !== null;
    this.surface.material.wireframe = look.wireframe;
    if (look.cut) {
      const axis = look.cut;
      this.plane.normal.set(0, 0, 0)[axis] = -1;
      this.plane.constant = this.low[axis] + (this.high[axis] - this.low[axis]) * look.cutAt;
    }
    const planes = look.cut ? [this.plane] : [];
    this.surface.material.clippingPlanes = planes;
    this.dots.material.clippingPlanes = planes;
    this.draw();
  }

  private kept({ point }: Intersection): boolean {
    return !this.look?.cut || this.plane.distanceToPoint(point) >= 0;
  }

  private mark(): void {
    for (const object of [this.marks, this.tape]) {
      object.geometry.dispose();
      object.geometry = new BufferGeometry().setFromPoints(this.picks);
    }
    const [x, y, z] = this.origin ?? [0, 0, 0];
    this.onPick(this.picks.map((at) => [at.x + x, at.y + y, at.z + z]));
    this.draw();
  }

  private fit(): void {
    const { clientWidth, clientHeight } = this.container;
    if (clientWidth === 0 || clientHeight === 0) return;
    this.renderer.setSize(clientWidth, clientHeight);
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  private draw(): void {
    if (this.pending === 0) this.pending = requestAnimationFrame(() => this.render());
  }

  private render(): void {
    this.pending = 0;
    this.renderer.render(this.world, this.camera);
  }
}
