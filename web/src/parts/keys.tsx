// The keys of the tenant, for those who may make them and take them out of use.

import { useEffect, useState } from 'preact/hooks';
import { erase, Failure, get, post, words } from '../api/client';
import type { Key, KeyRequest } from '../api/types';
import { known, may, type Scope } from '../state/session';
import { Copy, Panel, Time, Trouble } from './basic';
import { confirm } from './confirm';
import { say } from './say';

const SCOPES: Record<Scope, string> = {
  read: 'look and download', write: 'upload and start jobs', delete: 'hold and erase', audit: 'read the audit trail', admin: 'make keys, see measures',
};

export function KeysPanel() {
  const [keys, setKeys] = useState<Key[] | null>(null);
  const [trouble, setTrouble] = useState('');
  const look = () => void get<{ items: Key[] }>('/v1/keys').then(({ items }) => setKeys(items), (error: unknown) => setTrouble(words(error)));
  useEffect(look, []);
  const remove = async ({ id, name }: Key) => {
    const yes = await confirm({ title: `Take the key ${name} out of use?`, text: 'Whoever has it can do nothing with it from now on.', action: 'Take out', danger: true });
    if (!yes) return;
    await erase(`/v1/keys/${id}`).then(() => say(`${name} is out of use.`), (error: unknown) => say(words(error)));
    look();
  };
  return (
    <Panel title="Keys">
      {trouble && <Trouble>{trouble}</Trouble>}
      {!known() && <p>The service has no keys: whoever reaches it may do everything. <code>meshway key new</code> makes the first one.</p>}
      {keys && keys.length > 0 && (
        <div class="wide-table">
          <table class="small-table">
            <thead><tr>{['Name', 'May', 'Used last', 'Ends', ''].map((name) => <th scope="col">{name || <span class="unseen">Action</span>}</th>)}</tr></thead>
            <tbody>{keys.map((key) => (
              <tr>
                <th scope="row">{key.name}</th>
                <td>{key.scopes.join(', ')}{key.networks.length > 0 && `, from ${key.networks.join(', ')}`}</td>
                <td>{key.last_used_at ? <Time at={key.last_used_at} /> : 'never'}</td>
                <td>{key.expires_at ? <Time at={key.expires_at} /> : 'never'}</td>
                <td>{key.in_file ? <span class="muted">in the file of the operator</span>
                  : <button type="button" class="small danger" aria-label={`Take out ${key.name}`} onClick={() => void remove(key)}>Take out</button>}</td>
              </tr>
            ))}</tbody>
          </table>
        </div>
      )}
      {known() && <Make onMade={look} />}
    </Panel>
  );
}

function Make({ onMade }: { onMade: () => void }) {
  const [name, setName] = useState('');
  const [scopes, setScopes] = useState<ReadonlySet<Scope>>(new Set(['read', 'write']));
  const [failure, setFailure] = useState<Failure | null>(null);
  const [made, setMade] = useState<(Key & { key: string }) | null>(null);
  const start = async () => {
    try {
      const asked: KeyRequest = { name, scopes: [...scopes] };
      setMade(await post<Key & { key: string }>('/v1/keys', asked));
      setFailure(null);
      setName('');
      onMade();
    } catch (error) {
      setFailure(error instanceof Failure ? error : new Failure(words(error), 0, null));
    }
  };
  const fault = failure?.faults.get('/name') ?? failure?.message;
  return (
    <details>
      <summary>Make a key</summary>
      <form onSubmit={(event) => {
        event.preventDefault();
        void start();
      }}>
        <div class="field"><label for="key-name">Name, as the audit trail shall have it</label>
          <input id="key-name" type="text" autocomplete="off" required maxLength={64} value={name} aria-invalid={fault !== undefined}
            aria-describedby={fault ? 'key-name-fault' : undefined} onInput={({ currentTarget }) => setName(currentTarget.value)} />
          {fault && <p id="key-name-fault" class="fault" role="alert">{fault}</p>}
        </div>
        <fieldset class="parts"><legend>What it may</legend>
          {(Object.entries(SCOPES) as [Scope, string][]).map(([scope, text]) => (
            <label class="check">
              <input type="checkbox" checked={scopes.has(scope)} disabled={!may(scope)} onChange={({ currentTarget: { checked } }) => {
                const next = new Set(scopes);
                if (checked) next.add(scope);
                else next.delete(scope);
                setScopes(next);
              }} />
              <span>{scope}: <span class="muted">{text}</span></span>
            </label>
          ))}
        </fieldset>
        <button type="submit" disabled={scopes.size === 0}>Make the key</button>
      </form>
      {made && (
        <div role="status">
          <p class="hint">This is shown once. Keep it now: only its hash stays here.</p>
          <pre tabIndex={0} aria-label={`The key ${made.name}`}><code>{made.key}</code></pre>
          <Copy text={made.key} label={`the key ${made.name}`} />
        </div>
      )}
    </details>
  );
}
