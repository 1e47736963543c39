// Files can be dropped anywhere on any page.

import { signal } from '@preact/signals';
import { useEffect, useRef } from 'preact/hooks';
import { add } from '../state/drafts';
import { go, href } from '../state/route';

const over = signal(false);

function take(files: FileList | null | undefined): void {
  if (!files || files.length === 0) return;
  add(files);
  go(href('new'));
}

const carriesFiles = (event: DragEvent) => event.dataTransfer?.types.includes('Files') ?? false;

export function DropAnywhere() {
  useEffect(() => {
    let depth = 0;
    const enter = (event: DragEvent) => {
      if (!carriesFiles(event)) return;
      depth += 1;
      over.value = true;
    };
    const leave = (event: DragEvent) => {
      if (!carriesFiles(event)) return;
      depth -= 1;
      if (depth <= 0) over.value = false;
    };
    const hover = (event: DragEvent) => {
      if (carriesFiles(event)) event.preventDefault();
    };
    const drop = (event: DragEvent) => {
      if (!carriesFiles(event)) return;
      event.preventDefault();
      depth = 0;
      over.value = false;
      take(event.dataTransfer?.files);
    };
    const paste = (event: ClipboardEvent) => take(event.clipboardData?.files);
    addEventListener('dragenter', enter);
    addEventListener('dragleave', leave);
    addEventListener('dragover', hover);
    addEventListener('drop', drop);
    addEventListener('paste', paste);
    return () => {
      removeEventListener('dragenter', enter);
      removeEventListener('dragleave', leave);
      removeEventListener('dragover', hover);
      removeEventListener('drop', drop);
      removeEventListener('paste', paste);
    };
  }, []);
  return over.value ? <div class="drop-veil" aria-hidden="true"><div>Drop files here</div></div> : null;
}

/** The button for those who do not drag. */
export function ChooseFiles({ label, primary }: { label: string; primary?: boolean }) {
  const input = useRef<HTMLInputElement>(null);
  return (
    <span>
      <button type="button" class={primary ? 'primary' : ''} onClick={() => input.current?.click()}>{label}</button>
      <input ref={input} type="file" multiple class="hidden" tabIndex={-1} aria-hidden="true"
        onChange={({ currentTarget }) => {
          take(currentTarget.files);
          currentTarget.value = '';
        }} />
    </span>
  );
}
