// The settings of a job as a form: those most turned in front, all others behind a fold. Names,
// bounds and descriptions are those of the contract, defaults those of the preset.

import type { PresetEntry, Settings } from '../api/types';
import contract from '../api/settings.json';
import { CHOICES, COMMON } from '../words';
import { count } from '../format';

export interface Setting {
  group: string;
  name: string;
  type: string;
  options?: string[];
  minimum?: number;
  maximum?: number;
  description: string;
}

/** What differs from the preset, by `group.name`, as it was typed. */
export type Changes = Record<string, string>;

export const SETTINGS = contract as Setting[];

const path = ({ group, name }: Setting) => `${group}.${name}`;
const byPath = new Map(SETTINGS.map((setting) => [path(setting), setting]));
const common = Object.keys(COMMON).flatMap((name) => byPath.get(name) ?? []);
const others = SETTINGS.filter((setting) => !(path(setting) in COMMON));

export function valueOf(settings: Settings | undefined, group: string, name: string): unknown {
  return (settings as Record<string, Record<string, unknown>> | undefined)?.[group]?.[name];
}

function parsed({ type }: Setting, text: string): unknown {
  if (type === 'array') return text.split(/[\s,]+/).filter(Boolean).map(Number);
  return type === 'string' || text.trim() === '' || Number.isNaN(Number(text)) ? text : Number(text);
}

/** As the API wants it. */
export function asSettings(changes: Changes): Settings {
  const settings: Record<string, Record<string, unknown>> = {};
  for (const [name, text] of Object.entries(changes)) {
    const setting = byPath.get(name);
    if (setting) (settings[setting.group] ??= {})[setting.name] = parsed(setting, text);
  }
  return settings as Settings;
}

export function shown(value: unknown): string {
  if (Array.isArray(value)) return value.join(', ');
  return value === undefined || value === null ? '' : String(value);
}

/** Where settings are not those of the preset. */
export function differences(settings: Settings, preset: Settings | undefined): { name: string; here: string; there: string }[] {
  return SETTINGS.map(({ group, name }) => ({
    name: `${group}.${name}`,
    here: shown(valueOf(settings, group, name)),
    there: shown(valueOf(preset, group, name)),
  })).filter(({ here, there }) => here !== there);
}

/** Bounds, where they are worth a word. */
function range({ minimum, maximum }: Setting): string {
  if (minimum === undefined || maximum === undefined || maximum > 1e9) return '';
  return ` ${minimum} to ${maximum < 1 ? maximum : count(maximum)}.`;
}

interface Props {
  preset: PresetEntry | undefined;
  changes: Changes;
  faults: Map<string, string>;
  onChange: (changes: Changes) => void;
}

export function SettingsForm(props: Props) {
  const foldedFault = others.some(({ group, name }) => props.faults.has(`/settings/${group}/${name}`));
  return (
    <>
      <div class="fields">{common.map((setting) => <Field setting={setting} {...props} />)}</div>
      <details open={foldedFault || undefined}>
        <summary>All other settings</summary>
        <div class="fields">{others.map((setting) => <Field setting={setting} {...props} />)}</div>
      </details>
    </>
  );
}

function Field({ setting, preset, changes, faults, onChange }: Props & { setting: Setting }) {
  const name = path(setting);
  const standard = shown(valueOf(preset?.settings, setting.group, setting.name));
  const value = changes[name] ?? standard;
  const fault = faults.get(`/settings/${setting.group}/${setting.name}`);
  const set = (text: string) => {
    const { [name]: _old, ...rest } = changes;
    onChange(text === standard ? rest : { ...rest, [name]: text });
  };
  const id = `setting-${setting.group}-${setting.name}`;
  const common = {
    id,
    'aria-describedby': `${id}-help${fault ? ` ${id}-fault` : ''}`,
    'aria-invalid': fault !== undefined,
  };
  return (
    <div class={`field ${name in changes ? 'changed' : ''}`}>
      <label for={id}>{COMMON[name]?.title ?? name}</label>
      {setting.options
        ? (
          <select {...common} value={value} onChange={({ currentTarget }) => set(currentTarget.value)}>
            {setting.options.map((option) => <option value={option}>{CHOICES[name]?.[option] ?? option}</option>)}
          </select>
        )
        : (
          <input {...common} type="text" inputMode={setting.type === 'array' ? 'text' : 'decimal'} autocomplete="off"
            value={value} onInput={({ currentTarget }) => set(currentTarget.value)} />
        )}
      {fault && <p id={`${id}-fault`} class="fault">{fault}</p>}
      <p id={`${id}-help`} class="help">
        {COMMON[name]?.text ?? setting.description}
        {range(setting)}
        {name in changes && ` The preset has ${standard || 'none'}.`}
      </p>
    </div>
  );
}
